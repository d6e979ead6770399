// Order of the results of a search: Sphinx ranks pages that contain all words almost alike, so the section decides.
const SECTIONS = [
  [/^docs\/reference\/api\//, -20], // names of Python after every page
  [/^docs\/(start|how_to)\//, 3],
  [/^docs\/(explanation|reference)\//, 2],
  [/^(README|CHANGELOG|CONTRIBUTING)|^docs\/(development|index|gallery)/, -3],
];

var Scorer = {
  score: ([page, , , , score]) => score + (SECTIONS.find(([pattern]) => pattern.test(page)) ?? [null, 0])[1],
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};

// A browser does not read pages of a folder for the excerpts below the results; without this, each result is an error.
if (location.protocol === "file:") DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = false;
