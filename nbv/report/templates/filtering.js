// Filtering: a choice for each of some columns of a table, and a search in a long one; other rows are hidden.

function filterable(table) {
  const rows = [...table.tBodies[0].rows], more = table.parentElement.nextElementSibling?.matches(".more") ? table.parentElement.nextElementSibling : null;
  const heads = [...table.tHead.rows[0].cells].filter(head => "filter" in head.dataset);
  if ((!heads.length && !more) || rows.length < 2) return;
  const bar = document.createElement("p"), shown = document.createElement("output"), search = document.createElement("input");
  const text = (row, column) => row.cells[column].textContent.trim();
  const choices = heads.map(head => {
    const column = head.cellIndex, choice = document.createElement("select");
    const values = [...new Set(rows.map(row => text(row, column)))].sort((a, b) => a.localeCompare(b, "en", { numeric: true }));
    choice.append(new Option(`${head.textContent}: all`), ...values.map(value => new Option(value || "none named", value)));
    choice.setAttribute("aria-label", head.textContent);
    return { column, choice };
  });
  const first = more && rows.length - Number(more.querySelector("b").textContent);
  const show = () => {
    const sought = search.value.trim().toLowerCase();
    rows.forEach(row => {
      row.hidden = !row.textContent.toLowerCase().includes(sought)
        || choices.some(({ column, choice }) => choice.selectedIndex > 0 && text(row, column) !== choice.value);
    });
    const left = rows.filter(row => !row.hidden).length;
    shown.textContent = ` ${left} of ${rows.length} rows`;
    if (more) more.querySelector("b").textContent = left - first;
    if (more) more.hidden = left <= first;
  };
  bar.className = "filters";
  Object.assign(search, { type: "search", placeholder: "Search the table", ariaLabel: "Search the table" });
  bar.append(...(more ? [search] : []), ...choices.map(({ choice }) => choice), shown);
  bar.addEventListener("change", show);
  search.addEventListener("input", show);
  table.parentElement.before(bar);
  show();
}

document.querySelectorAll("table").forEach(filterable);
