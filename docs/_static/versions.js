// A list of the published versions at the top of the sidebar. versions.json lies beside the folders of the versions
// (release/site.py writes both). Without it there is one version only, as in pages that are opened as files.
(async () => {
  const brand = document.querySelector(".sidebar-brand");
  if (!brand || !location.protocol.startsWith("http")) return;
  const root = new URL(document.documentElement.dataset.content_root, location.href);
  const answer = await fetch(new URL("../versions.json", root)).catch(() => null);
  if (!answer?.ok) return;
  const links = (await answer.json()).map(({ folder, title }) => {
    const link = document.createElement("a");
    link.href = new URL(`../${folder}/`, root).href;
    link.textContent = title;
    if (link.href === root.href) link.setAttribute("aria-current", "true");
    // The same page of the other version, if that version has it.
    link.addEventListener("click", async (event) => {
      event.preventDefault();
      const same = new URL(location.pathname.slice(root.pathname.length) + location.hash, link.href);
      const there = await fetch(same, { method: "HEAD" }).catch(() => null);
      location.assign(there?.ok ? same : link.href);
    });
    return link;
  });
  const shown = document.createElement("summary");
  shown.textContent = `Version: ${links.find((link) => link.ariaCurrent)?.textContent ?? "unpublished"}`;
  const list = document.createElement("details");
  list.className = "versions";
  list.append(shown, ...links);
  brand.after(list);
})();
