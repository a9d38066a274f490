"use strict";
(() => {
  const pictures = JSON.parse(document.getElementById("pictures").textContent);
  const places = [...document.querySelectorAll("[data-picture]")];
  const chosen = { view: "allan", units: "datasheet" };
  const printed = { whole: 680, half: 330, beside: 305 }; // widths (CSS pixels) of a picture on A4
  let printing = false;
  const font = 'system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif';

  // Return the figure in the chosen view and units, or in other view or units if it is not available in these.
  function variant(name) {
    const all = pictures[name];
    const keys = [`${chosen.view}-${chosen.units}`, `${chosen.view}-si`, `wavelet-${chosen.units}`, ...Object.keys(all)];
    return all[keys.find((key) => key in all)];
  }

  const pen = document.createElement("canvas").getContext("2d");
  const decoded = (text) => new DOMParser().parseFromString(text, "text/html").body.textContent;
  const widthOf = (name) => Math.max(...name.split("<br>").map((line) => pen.measureText(decoded(line)).width));

  // Return a name in several lines if it is wider than the room.
  function folded(name, room) {
    const breaks = widthOf(name) > room ? [...name.matchAll(/ (?=\()|(?<=[,:+]) /g)].map((space) => space.index) : [];
    const last = breaks.findLast((place) => widthOf(name.slice(0, place)) <= room);
    return last ? `${name.slice(0, last)}<br>${folded(name.slice(last + 1), room)}` : name;
  }

  function layoutOf(picture, data, width) {
    const size = printing ? 8 : 11.5;
    pen.font = `${size}px ${font}`;
    // Plotly limits the legend to the width of the panel. Entries that do not fit are in the next row.
    const room = width - (printing ? 62 : 78);
    const entries = data.filter((trace) => trace.showlegend);
    for (const trace of entries) trace.name = folded(trace.name, room - 47);
    const entry = Math.min(room, 47 + Math.max(0, ...entries.map((trace) => widthOf(trace.name))));
    const rows = Math.ceil(picture.entries / Math.max(1, Math.floor(room / entry)));
    // A row of the legend has at least 19 pixels. If the margin is too small, Plotly moves the title of the axis up.
    const foot = (printing ? 44 : 50) + 19 * rows + 15 * entries.reduce((sum, trace) => sum + trace.name.split("<br>").length - 1, 0);
    const layout = structuredClone(picture.layout);
    for (const [name, axis] of Object.entries(layout)) {
      if (printing && name.startsWith("yaxis") && axis.title) axis.title.font = { size: 7 };
    }
    if (printing) for (const text of layout.annotations ?? []) text.font.size = size;
    return {
      ...layout,
      width, height: (printing ? (width > printed.half ? 150 : 104) : width < 620 ? 240 : 330) + foot, autosize: false,
      margin: { l: printing ? 48 : 64, r: 14, t: printing ? 16 : 26, b: foot, pad: 0 },
      font: { family: font, size: printing ? 8 : 12, color: "#1b1f24" },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      hovermode: "closest", dragmode: false, hoverlabel: { align: "left", bgcolor: "#ffffff", font: { size: 13 } },
      legend: { orientation: "h", maxheight: 1000, x: 0, xref: "container", y: 0, yref: "container", yanchor: "bottom",
                entrywidth: entry - 45, traceorder: "normal", font: { size } },
    };
  }

  // A hidden curve stays hidden in another view. Its name may differ there, but its position in the legend is the same.
  function hiddenIn(place) {
    return new Set((place.data || []).filter((t) => t.visible === "legendonly").map((t) => t.legendrank));
  }

  function paper(place) {
    return place.closest(".sensor") ? printed.beside : place.closest(".pair, .two") ? printed.half : printed.whole;
  }

  function draw(place) {
    const picture = variant(place.dataset.picture);
    const hidden = hiddenIn(place);
    const data = structuredClone(picture.data);
    for (const trace of data) {
      if (hidden.has(trace.legendrank)) trace.visible = "legendonly";
      // The table beside a printed figure has the values.
      if (printing) trace.name = trace.name.replace(/(: (?!zero)|, (any|not) ).*/, "");
    }
    const config = { displaylogo: false, displayModeBar: false, responsive: false };
    place.style.minHeight = "0";
    return Plotly.react(place, data, layoutOf(picture, data, printing ? paper(place) : place.clientWidth), config);
  }

  // A figure in a folded part is drawn when the part is opened.
  function drawAll() {
    const shown = places.filter((place) => !place.closest("details:not([open])"));
    for (const place of shown) draw(place);
    return shown.length;
  }

  for (const part of document.querySelectorAll("details")) {
    part.addEventListener("toggle", () => {
      if (part.open && !printing) for (const place of part.querySelectorAll("[data-picture]")) draw(place);
    });
  }

  // A link to a folded part opens it.
  function openTarget() {
    const target = document.getElementById(location.hash.slice(1));
    if (target instanceof HTMLDetailsElement) {
      target.open = true;
      target.scrollIntoView();
    }
  }
  window.addEventListener("hashchange", openTarget);
  for (const link of document.querySelectorAll("nav a")) link.addEventListener("click", () => setTimeout(openTarget));

  for (const button of document.querySelectorAll("button[data-set]")) {
    button.addEventListener("click", () => {
      const { set, value } = button.dataset;
      chosen[set] = value;
      for (const other of document.querySelectorAll(`button[data-set="${set}"]`)) {
        other.setAttribute("aria-pressed", String(other === button));
      }
      drawAll();
    });
  }

  // Browsers may not let pages from a file use the clipboard. In this case, select the text and copy it.
  function copySelected(text) {
    const field = document.createElement("textarea");
    field.value = text;
    document.body.append(field);
    field.select();
    const done = document.execCommand("copy");
    field.remove();
    return done;
  }

  async function copy(text) {
    try {
      await navigator.clipboard.writeText(text);
      return true;
    } catch {
      return copySelected(text);
    }
  }

  for (const button of document.querySelectorAll("button[data-copy]")) {
    button.addEventListener("click", async () => {
      const done = await copy(document.getElementById(button.dataset.copy).textContent);
      button.textContent = done ? "Copied" : "Select and copy by hand";
      setTimeout(() => { button.textContent = "Copy"; }, 2000);
    });
  }

  // A table or text that is wider than the page can be scrolled with the keyboard.
  const focusable = () => {
    for (const part of document.querySelectorAll(".wide, pre")) part.tabIndex = part.scrollWidth > part.clientWidth ? 0 : -1;
  };
  document.addEventListener("toggle", focusable, true);

  let width = window.innerWidth;
  window.addEventListener("resize", () => {
    if (window.innerWidth === width || printing) return;
    width = window.innerWidth;
    drawAll();
    focusable();
  });

  let closed = [];
  window.addEventListener("beforeprint", () => {
    printing = true;
    closed = [...document.querySelectorAll("details:not([open], .screen)")];
    for (const part of closed) part.open = true;
    drawAll();
  });
  window.addEventListener("afterprint", () => {
    printing = false;
    for (const part of closed) part.open = false;
    drawAll();
  });

  openTarget();
  focusable();
  document.documentElement.dataset.drawn = String(drawAll());
})();
