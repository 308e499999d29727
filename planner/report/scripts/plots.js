// Plots over time, drawn by Plotly, which is unpacked when the first of them is about to be seen.
"use strict";

live.library = () => {
  live.unpacked ??= (async () => {
    const packed = atob(document.getElementById("plotly").textContent.trim());
    const bytes = Uint8Array.from(packed, (letter) => letter.charCodeAt(0));
    const stream = new DecompressionStream("gzip"), writer = stream.writable.getWriter();
    writer.write(bytes).then(() => writer.close()).catch(() => {}); // the reader of the stream reports what fails
    document.head.append(live.element("script", { textContent: await new Response(stream.readable).text() }));
  })();
  return live.unpacked;
};

// What is drawn first, and what a reader does to it, on Plotly's terms.
live.kinds.plot = async (figure, { data, layout, clock, height, views }) => {
  const place = live.element("div", { className: "canvas" });
  place.style.height = `${height}px`;
  const names = [...new Set(data.filter((trace) => trace.showlegend !== false).map((trace) => trace.name))];
  const entries = names.map((name) => {
    const rows = [...data.keys()].filter((k) => data[k].name === name && data[k].showlegend !== false);
    const { line, marker, visible } = data[rows[0]];
    const looks = line ? { colour: line.color, width: line.width, dashes: line.dash.replaceAll("px", "").replace("solid", "none") }
      : { colour: marker.line.color, width: 1, dashes: "dots", filled: marker.line.width === 0 };
    return live.entry({ name, ...looks, hidden: visible !== true }, (shown) => {
      for (const k of rows) data[k].visible = shown; // for when the colours change
      Plotly.restyle(place, { visible: shown }, rows);
    });
  });
  const spans = Object.entries(views).map(([name, range]) => live.element("button", {
    type: "button",
    textContent: name,
    onclick: () => Plotly.relayout(place, { "xaxis.range": range, ...rowsWhole }),
  }));
  const rowsWhole = Object.fromEntries(Object.keys(layout).filter((key) => /^yaxis/.test(key)).map((key) => [`${key}.autorange`, true]));
  figure.append(live.element("div", { className: "entries" }, ...entries), place);
  if (spans.length) figure.append(live.element("div", { className: "views" }, ...spans));
  await live.library();
  const font = { family: getComputedStyle(document.body).fontFamily, size: 12.5, color: "var(--ink)" };
  const small = { color: "var(--muted)", size: 12 };
  const looks = {
    font,
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    hoverlabel: { bgcolor: "var(--surface)", bordercolor: "var(--line)", font },
    dragmode: live.touch ? false : "zoom", // a finger on a plot scrolls the page
    modebar: { color: "var(--muted)", activecolor: "var(--accent)", bgcolor: "rgba(0,0,0,0)" },
    autosize: true,
  };
  for (const [key, axis] of Object.entries(layout)) {
    if (/^[xy]axis/.test(key)) Object.assign(axis, { tickfont: small, title: { ...axis.title, font: small } });
  }
  const config = {
    displaylogo: false,
    displayModeBar: true,
    modeBarButtons: [[...(live.touch ? [] : ["zoom2d", "pan2d"]), "zoomIn2d", "zoomOut2d", "resetScale2d", "toImage"]],
    responsive: true,
    showTips: false,
  };
  // What the reader has hidden or zoomed stays so when the colours change: uirevision.
  const draw = () => {
    const shapes = (place.layout?.shapes ?? layout.shapes).slice(0, 1);
    const width = live.PAPER * (figure.closest(".wide, .pictures > :only-child, section > figure") ? 2 : 1);
    const paper = matchMedia("print").matches ? { autosize: false, width } : {};
    const now = live.coloured({ ...looks, ...layout, ...paper });
    if (clock && place.layout) Object.assign(now.shapes[0], { x0: shapes[0].x0, x1: shapes[0].x1 });
    return Plotly.react(place, live.coloured(data), now, config);
  };
  await draw();
  // A picture of any width fits the paper.
  const scale = () => place.querySelectorAll(".main-svg").forEach((svg) => {
    const [width, height] = [svg.width, svg.height].map((side) => side.baseVal.value);
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    place.style.setProperty("--ratio", `${width} / ${height}`);
  });
  scale();
  place.on("plotly_afterplot", scale);
  for (const change of live.colours) change.addEventListener("change", draw);
  if (!clock) return;
  const point = (moment) => Plotly.relayout(place, { "shapes[0].x0": moment * clock, "shapes[0].x1": moment * clock });
  let visible = true;
  new IntersectionObserver(([entry]) => {
    visible = entry.isIntersecting;
    if (visible) point(live.moment);
  }).observe(place);
  document.addEventListener("moment", ({ detail }) => visible && point(detail.moment));
  place.on("plotly_hover", ({ xvals }) => live.show(xvals[0] / clock, place));

  // Plots that follow the same moment show the same span of time, those drawn later too.
  let following = false;
  const follow = async () => {
    following = true;
    await Plotly.relayout(place, { "xaxis.range": live.span.map((time) => time * clock) });
    following = false;
  };
  if (live.span) await follow();
  document.addEventListener("span", ({ detail }) => detail.from !== place && follow());
  place.on("plotly_relayout", (changed) => {
    if (following || !Object.keys(changed).some((key) => key.startsWith("xaxis."))) return;
    live.span = place.layout.xaxis.range.map((time) => time / clock);
    document.dispatchEvent(new CustomEvent("span", { detail: { from: place } }));
  });
};
