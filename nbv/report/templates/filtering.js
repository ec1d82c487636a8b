// Filtering: a choice for each of some columns of a table; rows with other values are not shown.

function filterable(table) {
  const rows = [...table.tBodies[0].rows];
  const heads = [...table.tHead.rows[0].cells].filter(head => "filter" in head.dataset);
  if (!heads.length || rows.length < 2) return;
  const bar = document.createElement("p"), shown = document.createElement("output");
  const text = (row, column) => row.cells[column].textContent.trim();
  const choices = heads.map(head => {
    const column = head.cellIndex, choice = document.createElement("select");
    const values = [...new Set(rows.map(row => text(row, column)))].sort((a, b) => a.localeCompare(b, "en", { numeric: true }));
    choice.append(new Option(`${head.textContent}: all`), ...values.map(value => new Option(value || "none named", value)));
    choice.setAttribute("aria-label", head.textContent);
    return { column, choice };
  });
  const show = () => {
    rows.forEach(row => { row.hidden = choices.some(({ column, choice }) => choice.selectedIndex > 0 && text(row, column) !== choice.value); });
    shown.textContent = ` ${rows.filter(row => !row.hidden).length} of ${rows.length}`;
  };
  bar.className = "filters";
  bar.append(...choices.map(({ choice }) => choice), shown);
  bar.addEventListener("change", show);
  table.parentElement.before(bar);
  show();
}

document.querySelectorAll("table").forEach(filterable);
