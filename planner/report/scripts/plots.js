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

// A figure in Plotly's terms: zoom one panel along x, and all follow.
live.PANEL = 150; // height of a usual panel [px]
live.GAP = 34; // between panels, room for a title [px]

live.roomOf = ({ x, panels }) => {
  const heights = panels.map((panel) => live.PANEL * panel.height);
  const inner = heights.reduce((sum, height) => sum + height) + live.GAP * (heights.length - 1);
  const above = 30 + (panels[0].title ? 18 : 0); // for the buttons
  const below = x.names && !x.names.length ? 8 : 46; // for the axis
  return { heights, inner, above, below, height: inner + above + below };
};

live.axisOf = ({ title, unit, note, names }, standoff) => ({
  gridcolor: "var(--grid)",
  linecolor: "var(--muted)",
  zeroline: false,
  title: { text: live.text(`${title}${unit && ` [${unit}]`}${note}`), standoff },
  ...(names && {
    tickvals: names.map(([value]) => value),
    ticktext: names.map(([, name]) => live.text(name)),
    automargin: true,
    showgrid: false,
  }),
});

// A curve with its looks, and with what is written beside the pointer.
live.traceOf = (curve, { x, over_time: overTime }, { y }, yaxis) => {
  const { role, marks, opacity, notes } = curve, faint = opacity < 1;
  const [xValues, yValues] = [curve.x, curve.y].map((bdata) => ({ dtype: "f4", bdata }));
  const line = {
    color: role.colour,
    width: role.pixels,
    dash: role.strokes,
    shape: curve.held ? "hv" : "linear",
    simplify: false, // which makes a polygon of a wide line
  };
  const marker = marks === "rings" ? { color: "rgba(0,0,0,0)", line: { color: role.colour, width: 1.6 } }
    : { color: role.colour, opacity, line: { color: role.colour, width: 0 } };
  const note = notes.length ? " · %{text}" : "";
  const values = [["x", x], ["y", y]].filter(([, axis]) => !axis.names)
    .map(([letter, axis]) => `%{${letter}:.${axis.decimals}f} ${axis.unit}`.trimEnd());
  const words = overTime ? `%{y:.${y.decimals}f} ${y.unit}${note}` : `${values.join(", ")}${note}<extra>%{fullData.name}</extra>`;
  return {
    type: "scatter",
    name: curve.label || role.label,
    x: xValues,
    y: yValues,
    yaxis,
    visible: curve.hidden ? "legendonly" : true,
    connectgaps: false,
    ...(marks ? { mode: "markers", marker: { ...marker, size: faint ? 4.5 : 7 } } : { mode: "lines", line }),
    ...(note && { text: notes }),
    ...(curve.legend ? { hovertemplate: words } : { hoverinfo: "skip", showlegend: false }),
  };
};

live.plotOf = (figure) => {
  const { x, panels, clock, over_time: overTime } = figure, { heights, inner, above, below } = live.roomOf(figure);
  const [start, end] = x.range, axes = {}, data = [], annotations = [], shapes = [];
  const across = { ...live.axisOf(x, 8), range: x.range };
  if (overTime) {
    Object.assign(across, {
      anchor: panels.length > 1 ? `y${panels.length}` : "y",
      minallowed: start,
      maxallowed: end,
      unifiedhovertitle: { text: `%{x:.${x.decimals}f} ${x.unit}` },
      ...(clock === null && {
        showspikes: true,
        spikemode: "across",
        spikesnap: "cursor",
        spikethickness: 1,
        spikedash: "solid",
        spikecolor: "var(--muted)",
      }),
    });
  }
  if (clock !== null) { // the line at the moment of the moving leg, which moves it
    shapes.push({ type: "line", xref: "x", yref: "paper", x0: 0, x1: 0, y0: 0, y1: 1, line: { color: "var(--ink)", width: 1.2 }, layer: "above" });
  }
  let top = inner;
  panels.forEach((panel, k) => {
    const { y, curves, title, spans, words } = panel, axis = k ? `y${k + 1}` : "y";
    const domain = [Math.max(top - heights[k], 0) / inner, top / inner];
    top -= heights[k] + live.GAP;
    axes[axis.replace("y", "yaxis")] = {
      ...live.axisOf(y, 6),
      domain,
      ...(figure.equal && { scaleanchor: "x" }),
      ...(!y.names && { nticks: 6, rangemode: y.from_zero ? "tozero" : "normal" }),
      ...(y.range && { range: y.range }),
    };
    data.push(...curves.map((curve) => live.traceOf(curve, figure, panel, axis)));
    if (title) {
      annotations.push({ text: `<b>${live.text(title)}</b>`, x: 0, y: domain[1], xref: "paper", yref: "paper", xanchor: "left", yanchor: "bottom", showarrow: false });
    }
    annotations.push(...words.map((each) => ({
      text: live.text(each.text).replace("v_max", "v<sub>max</sub>"),
      x: each.x,
      y: each.y,
      xref: "x",
      yref: axis,
      xanchor: each.across,
      yanchor: each.upward,
      showarrow: false,
      font: { color: "var(--ink)", size: 12 },
    })));
    shapes.push(...spans.map(({ role, opacity, along, ...ends }) => ({
      type: "rect",
      ...(along === "x" ? { xref: "x", yref: `${axis} domain`, x0: ends.start, x1: ends.end, y0: 0, y1: 1 }
        : { xref: "paper", yref: axis, x0: 0, x1: 1, y0: ends.start, y1: ends.end }),
      fillcolor: role.colour,
      opacity,
      line: { width: 0 },
      layer: "below",
    })));
  });
  const layout = {
    xaxis: across,
    ...axes,
    annotations,
    shapes,
    hovermode: overTime ? "x unified" : "closest",
    showlegend: false, // the page has its own, of buttons
    margin: { l: 58, r: 12, t: above, b: below },
    uirevision: "kept",
  };
  return { data, layout };
};

live.kinds.plot = async (figure, description) => {
  const { clock, views } = description, { data, layout } = live.plotOf(description), { height } = live.roomOf(description);
  const place = live.element("div", { className: "canvas" });
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
  const spans = views.map(([name, range]) => live.element("button", {
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
    height,
  };
  for (const [key, axis] of Object.entries(layout)) {
    if (/^[xy]axis/.test(key)) Object.assign(axis, { tickfont: small, title: { ...axis.title, font: small } });
  }
  const config = {
    displaylogo: false,
    displayModeBar: true,
    modeBarButtons: [[...(live.touch ? [] : ["zoom2d", "pan2d"]), "zoomIn2d", "zoomOut2d", "resetScale2d", "toImage"]],
    showTips: false,
  };
  // What the reader has hidden or zoomed stays so when the colours change: uirevision.
  const draw = () => {
    const shapes = (place.layout?.shapes ?? layout.shapes).slice(0, 1);
    const paper = live.PAPER * (figure.closest(".wide, .pictures > :only-child, section > figure") ? 2 : 1);
    const width = matchMedia("print").matches ? paper : place.clientWidth;
    const now = live.coloured({ ...looks, ...layout, width });
    if (clock && place.layout) Object.assign(now.shapes[0], { x0: shapes[0].x0, x1: shapes[0].x1 });
    return Plotly.react(place, live.coloured(data), now, config);
  };
  await draw();
  // A picture of any width fits the paper, and the screen until it is drawn for that.
  const scale = () => place.querySelectorAll(".main-svg").forEach((svg) => {
    const [width, height] = [svg.width, svg.height].map((side) => side.baseVal.value);
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    place.style.setProperty("--ratio", `${width} / ${height}`);
  });
  scale();
  place.on("plotly_afterplot", scale);
  for (const change of live.colours) change.addEventListener("change", draw);
  // Drawn anew, as a change of the width alone would widen the ranges of equal axes; not for the
  // window of a pixel in which browsers take pictures of whole pages.
  new ResizeObserver(() => {
    const width = place.clientWidth, fits = Math.abs(width - place.layout.width) < 1;
    if (width > 100 && !fits && !matchMedia("print").matches) draw();
  }).observe(place);
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
