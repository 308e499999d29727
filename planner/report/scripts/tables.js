// A button under every table that copies it as tab-separated values, for a spreadsheet.
"use strict";

// The cells as a grid: what spans rows or columns stands in the first, the others are empty.
function tableText(table) {
  const grid = [...table.rows].map(() => []);
  [...table.rows].forEach((row, r) => {
    let c = 0;
    for (const cell of row.cells) {
      while (grid[r][c] !== undefined) c += 1;
      const text = cell.innerText.replace(/\s+/g, " ").replace(/−/g, "-").trim();
      for (let down = 0; down < cell.rowSpan; down += 1) {
        for (let along = 0; along < cell.colSpan; along += 1) {
          grid[r + down][c + along] = down || along ? "" : text;
        }
      }
    }
  });
  return grid.map((row) => row.join("\t")).join("\n") + "\n";
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
  }
});
