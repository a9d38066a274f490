/* What a search puts first: exact words of titles, of the index and of the API; history and tables last. */
const LAST = /^(changelog|contributing\/index|contributing\/vocabulary|benchmarks|genindex|validation\/)/;
const LATER = /^api\//;
const ASKED = (new URLSearchParams(window.location.search).get("q") || "").trim().toLowerCase();
const IS_CODE = /[._]/.test(ASKED);
var Scorer = {
  score: ([page, , place, , score, , kind]) => {
    if (LAST.test(page)) return score - 12;
    const parts = kind === "object" ? (place || "").slice(1).toLowerCase().split(".") : [];
    // Who asks for a name as it is written in code wants that one, of the package before those of its classes.
    if (IS_CODE && `.${parts.join(".")}`.endsWith(`.${ASKED}`)) return score + 60 - 10 * parts.length;
    // Methods of results stand behind pages that explain; a name of the package itself does not.
    if (parts.length > 2) return score - 9;
    if (kind === "text" && LATER.test(page)) return score - 2;
    return score;
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
