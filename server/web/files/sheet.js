// Tables as rows of texts, for spreadsheets.

// A text that begins like a formula would be one in a spreadsheet, and names are chosen by anybody.
const isFormula = (text) => /^[=+\-@\t\r]/.test(text) && !/^-?[\d.,]+$/.test(text);

function cellText(cell) {
  const text = (cell.dataset.copy ?? cell.textContent).trim().replace(/\s+/g, " ");
  return isFormula(text) ? `'${text}` : text;
}

// The texts of a table's rows, the head first: of those that `wanted` takes. What only serves the page (class
// "page-only") is left out.
export function textsOf(element, wanted = () => true) {
  return [...element.rows].filter((row) => !row.hidden && !row.matches(".page-only") && wanted(row))
    .map((row) => [...row.cells].filter((cell) => !cell.matches(".page-only")).map(cellText));
}

export const asTsv = (rows) => rows.map((row) => row.join("\t")).join("\n");

const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll("\"", "\"\"")}"` : text);

// RFC 4180. `mark`: with the mark of UTF-8 at the start, which some spreadsheets need.
export function asCsv(rows, mark) {
  return (mark ? "\ufeff" : "") + rows.map((row) => `${row.map(quoted).join(",")}\r\n`).join("");
}

// For the event "copy" of a table: several rows that are selected become lines of cells.
export function copyRows(event) {
  const selection = getSelection();
  const rows = textsOf(event.currentTarget, (row) => selection.containsNode(row, true));
  if (rows.length < 2) return;
  event.clipboardData.setData("text/plain", asTsv(rows));
  event.preventDefault();
}

// Copies a text; whether that was allowed. Without the clipboard, which browsers give to secure origins only, the
// old way.
export async function copyText(text) {
  if (navigator.clipboard) return navigator.clipboard.writeText(text).then(() => true, () => false);
  const field = document.createElement("textarea");
  field.value = text;
  document.body.append(field);
  field.select();
  const done = document.execCommand("copy");
  field.remove();
  return done;
}

// Has the browser save a text or a Blob as a file.
export function save(content, file, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], {type}));
  link.download = file;
  link.click();
  URL.revokeObjectURL(link.href);
}
