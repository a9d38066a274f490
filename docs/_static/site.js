// Drawers by keys: who opens one is in it, who leaves it or presses Escape has closed it.
for (const [name, drawer] of [["__navigation", ".sidebar-drawer"], ["__toc", ".toc-drawer"]]) {
  const toggle = document.getElementById(name);
  const inside = document.querySelector(drawer);
  if (!toggle || !inside) continue;
  toggle.addEventListener("change", () => {
    if (!toggle.checked || !toggle.matches(":focus-visible")) return;
    [...inside.querySelectorAll("a, input")].find((thing) => thing.getClientRects().length)?.focus();
  });
  document.addEventListener("focusin", (event) => {
    if (event.target !== toggle && !inside.contains(event.target)) toggle.checked = false;
  });
  document.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || !toggle.checked) return;
    toggle.checked = false;
    toggle.focus();
  });
}

// A box that scrolls can be reached by keys; headings of the sidebar have a level.
const reach = () => {
  for (const box of document.querySelectorAll("article pre, article .table-wrapper, article p:has(> a > img)")) {
    if (box.scrollWidth > box.clientWidth + 1) box.tabIndex = 0;
    else box.removeAttribute("tabindex");
  }
};
reach();
addEventListener("resize", reach);
addEventListener("load", reach);
for (const caption of document.querySelectorAll('.caption[role="heading"]')) caption.setAttribute("aria-level", "2");
