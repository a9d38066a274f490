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

  // A dropped file of any size is copied to a temporary folder of the server.
  const hint = (text) => { document.querySelector("#drop .hint").textContent = text; };
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", async (event) => {
    event.preventDefault();
    const file = event.dataTransfer.files[0];
    if (!file) return;
    hint(`Copying ${file.name} …`);
    const answer = await fetch(`dropped?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
    hint(answer.ok ? "or drop a file here" : `${file.name} could not be copied`);
    if (answer.ok) set("dropped", { data: (await answer.json()).path });
  });

  // Folded parts are opened while the page is printed.
  let closed = [];
  window.addEventListener("beforeprint", () => {
    closed = [...document.querySelectorAll("section:not([hidden]) details:not([open])")];
    for (const one of closed) one.open = true;
  });
  window.addEventListener("afterprint", () => { for (const one of closed) one.open = false; });
})();
