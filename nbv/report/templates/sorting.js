// Sorting: a press on a column's title sorts its table by it, and once more the other way round.

function sortable(table) {
  const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
  if (body.rows.length < 2) return;
  heads.forEach((head, column) => {
    const press = document.createElement("button");
    press.type = "button";
    press.append(...head.childNodes);
    head.append(press);
    press.addEventListener("click", () => {
      const falls = head.getAttribute("aria-sort") === "ascending";
      heads.forEach(other => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", falls ? "descending" : "ascending");
      body.append(...sorted([...body.rows], column, falls));
    });
  });
}

// Rows by a column: numbers as numbers, then text, what is empty last; rows that are alike keep their order.
function sorted(rows, column, falls) {
  const keyed = rows.map(row => ({ row, key: sortKey(row.cells[column].textContent) }));
  const sign = falls ? -1 : 1;
  keyed.sort(({ key: a }, { key: b }) => a.rank - b.rank || sign * (a.rank === 0 ? a.value - b.value : a.rank === 1 ? a.text.localeCompare(b.text, "en", { numeric: true }) : 0));
  return keyed.map(({ row }) => row);
}

// ">99.9" lies beyond 99.9, "<0.1" below 0.1, "12.5 +- 0.1" at 12.5.
function sortKey(text) {
  const trimmed = text.trim(), found = trimmed.match(/^([<>]?)\s*([-+\u2212]?[\d.]+(?:e[-+]?\d+)?)(?:\s|%|,|$)/i);
  if (!trimmed) return { rank: 2 };
  if (!found) return { rank: 1, text: trimmed };
  const value = Number(found[2].replace("\u2212", "-")), nudge = 1e-9 * Math.max(Math.abs(value), 1e-3);
  return { rank: 0, value: value + (found[1] === ">" ? nudge : found[1] === "<" ? -nudge : 0) };
}

document.querySelectorAll("table").forEach(sortable);
