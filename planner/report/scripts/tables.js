// A button under every table that copies it as tab-separated values, for a spreadsheet; and rows as
// blocks of titles and values where a table is wider than the screen.
"use strict";

// The cells as a grid, in which a cell stands in every row and column that it spans.
function cellGrid(table) {
  const grid = [...table.rows].map(() => []);
  [...table.rows].forEach((row, r) => {
    let c = 0;
    for (const cell of row.cells) {
      while (grid[r][c]) c += 1;
      for (let down = 0; down < cell.rowSpan; down += 1) {
        for (let along = 0; along < cell.colSpan; along += 1) grid[r + down][c + along] = cell;
      }
    }
  });
  return grid;
}

const cellText = (cell) => cell.innerText.replace(/\s+/g, " ").replace(/−/g, "-").trim();

// Where a cell spans several places, its text stands in the first.
function tableText(table) {
  const grid = cellGrid(table);
  return grid.map((row, r) => row.map((cell, c) =>
    cell === row[c - 1] || cell === grid[r - 1]?.[c] ? "" : cellText(cell)).join("\t")).join("\n") + "\n";
}

// Long lists of numbers, in details, scroll instead.
function stackIfWide(frame) {
  frame.classList.remove("stack");
  frame.classList.toggle("stack", !frame.closest("details") && frame.scrollWidth > frame.clientWidth);
}

function titleCells(table) {
  const grid = cellGrid(table), heads = table.tHead.rows.length;
  for (const row of grid.slice(heads)) {
    row.forEach((cell, c) => {
      const more = c > 0 && grid[0][c] === grid[0][c - 1]; // under the title of the cell before
      cell.dataset.title = grid.slice(more, heads).map((head) => cellText(head[c])).filter(Boolean).join(", ");
      cell.classList.toggle("more", more);
      cell.classList.toggle("numbered", c === 0 && /^\d/.test(cellText(cell)));
      cell.classList.toggle("none", (more ? ["", "–"] : [""]).includes(cellText(cell)));
    });
  }
}

async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch { // not allowed, as in a page from a file in some browsers
    const area = live.element("textarea", { value: text });
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    if (!done) throw new Error("the browser does not let this page copy");
  }
}

document.addEventListener("DOMContentLoaded", () => {
  for (const frame of document.querySelectorAll(".scroll")) {
    const button = live.element("button", { type: "button", className: "copy", textContent: "copy table" });
    button.onclick = () => copyText(tableText(frame.querySelector("table")))
      .then(() => "copied", () => "cannot copy")
      .then((said) => {
        button.textContent = said;
        setTimeout(() => { button.textContent = "copy table"; }, 2000);
      });
    frame.after(button);
    titleCells(frame.querySelector("table"));
    stackIfWide(frame);
    addEventListener("resize", () => stackIfWide(frame));
  }
});
