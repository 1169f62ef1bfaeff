"use strict";

// Sorting: a click on a heading sorts by it, the better end first; cells without a value stay last.
function sortBy(heading) {
  const table = heading.closest("table");
  const column = [...heading.parentNode.children].indexOf(heading);
  const before = heading.getAttribute("aria-sort");
  const first = heading.dataset.first;
  const order = before === null ? first : before === "ascending" ? "descending" : "ascending";
  for (const other of heading.parentNode.children) other.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", order);
  const sign = order === "ascending" ? 1 : -1;
  const valueOf = (row) => row.children[column].dataset.value;
  const compare = (row0, row1) => {
    const [value0, value1] = [valueOf(row0), valueOf(row1)];
    if (value0 === "" || value1 === "") return (value0 === "") - (value1 === "");
    if (column === 0) return sign * value0.localeCompare(value1);
    return sign * (Number(value0) > Number(value1)) - sign * (Number(value0) < Number(value1));
  };
  const body = table.tBodies[0];
  body.append(...[...body.rows].sort(compare));
}
for (const heading of document.querySelectorAll("table.sortable th")) {
  heading.querySelector("button").addEventListener("click", () => sortBy(heading));
}

// Curves: the ticks above the charts of a pair set show and hide a detector in all of them.
function show(box) {
  for (const curve of box.closest("section").querySelectorAll(`.curve-${box.dataset.curve}`)) {
    curve.style.display = box.checked ? "" : "none";
  }
}
for (const box of document.querySelectorAll("input[data-curve]")) {
  box.addEventListener("change", () => show(box));
  show(box); // a browser may keep the ticks of an earlier visit
}
for (const button of document.querySelectorAll("button[data-show]")) {
  button.addEventListener("click", () => {
    const limit = Number(button.dataset.show);
    button.closest("fieldset").querySelectorAll("input").forEach((box, rank) => {
      box.checked = rank < limit;
      show(box);
    });
  });
}

// Tables: a hint above one that is wider than the page.
function hint() {
  for (const line of document.querySelectorAll(".hint")) {
    const box = line.nextElementSibling;
    line.classList.toggle("shown", box.scrollWidth > box.clientWidth + 1);
  }
}
addEventListener("resize", hint);
hint();

// On paper nothing can be opened.
addEventListener("beforeprint", () => {
  for (const folded of document.querySelectorAll("details")) folded.open = true;
});
