"use strict";
(() => {
  const set = (id, props) => window.dash_clientside.set_props(id, props);

  let waiting = 0;
  window.addEventListener("resize", () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => set("width", { data: document.documentElement.clientWidth }), 200);
  });

  // The arrow keys, Home and End move between the tabs.
  document.addEventListener("keydown", (event) => {
    const tab = event.target.closest('[role="tab"]');
    const step = { ArrowRight: 1, ArrowLeft: -1, Home: -Infinity, End: Infinity }[event.key];
    if (!tab || step === undefined) return;
    const tabs = [...document.querySelectorAll('[role="tab"]')];
    const at = Number.isFinite(step) ? (tabs.indexOf(tab) + step + tabs.length) % tabs.length : step < 0 ? 0 : tabs.length - 1;
    tabs[at].focus();
    tabs[at].click();
    event.preventDefault();
  });

  // A dropped file is copied to a temporary folder of the server.
  const hint = (text) => { document.querySelector("#drop .hint").textContent = text; };
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", async (event) => {
    event.preventDefault();
    const file = event.dataTransfer.files[0];
    if (!file) return;
    hint(`Copying ${file.name} …`);
    const answer = await fetch(`dropped?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
    hint(answer.ok ? "or drop a file here" : `${file.name}: ${await answer.text()}`);
    if (answer.ok) set("dropped", { data: (await answer.json()).path });
  });

  // Dash gives radio buttons, sliders and menus roles without names, and a hidden field that takes the focus.
  const mend = () => {
    for (const group of document.querySelectorAll(".choices .radio[role=listbox]")) {
      group.setAttribute("role", "radiogroup");
      group.setAttribute("aria-labelledby", `label-${group.id}`);
    }
    for (const option of document.querySelectorAll(".radio [role=option]")) {
      option.removeAttribute("role");
      option.removeAttribute("aria-selected");
    }
    for (const thumb of document.querySelectorAll("[role=slider]:not([aria-labelledby])")) {
      const label = thumb.closest(".sliders > div")?.querySelector("[id^=label-]");
      if (label) thumb.setAttribute("aria-labelledby", label.id);
    }
    for (const field of document.querySelectorAll(".dash-dropdown-focus-target[tabindex='0']")) field.tabIndex = -1;
    // A table that is wider than the page can be scrolled with the keyboard.
    for (const part of document.querySelectorAll(".wide:not([tabindex])")) {
      if (part.scrollWidth > part.clientWidth) part.tabIndex = 0;
    }
    // A place that waits for a job shows its progress.
    const doing = document.getElementById("doing")?.textContent ?? "";
    for (const place of document.querySelectorAll(".empty .waiting")) {
      if (doing && place.dataset.now !== doing) place.dataset.now = doing;
    }
  };
  new MutationObserver(mend).observe(document, { subtree: true, childList: true, characterData: true, attributes: true,
                                                 attributeFilter: ["role", "tabindex", "aria-selected"] });

  // Folded parts are opened while the page is printed.
  let closed = [];
  window.addEventListener("beforeprint", () => {
    closed = [...document.querySelectorAll("section:not([hidden]) details:not([open])")];
    for (const one of closed) one.open = true;
  });
  window.addEventListener("afterprint", () => { for (const one of closed) one.open = false; });
})();
