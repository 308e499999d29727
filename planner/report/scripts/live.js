// What all live figures of a page share: where they stand, the page's colours, and one moment in
// time.
"use strict";

const live = {
  figures: JSON.parse(document.getElementById("live-figures").textContent),
  colours: [matchMedia("(prefers-color-scheme: dark)"), matchMedia("print")], // which change them
  touch: matchMedia("(pointer: coarse)").matches,
  MARGIN: 600, // a figure that comes so near to the screen is about to be seen [px]
  MOST: 24, // figures that are drawn before they are about to be seen
  PAPER: 560, // width for which plots of half a page are drawn on paper, which scales them [px]
  PAUSE: 40, // between such figures, for what the reader does meanwhile [ms]
  kinds: {}, // how to draw a figure, by kind: (place, description) => a promise
  errors: [],

  // Text with the page's colours for var(--name), however deep it stands.
  coloured(value) {
    if (typeof value === "string") {
      return value.replace(/var\((--[\w-]+)\)/g, (_, name) =>
        getComputedStyle(document.documentElement).getPropertyValue(name).trim());
    }
    if (Array.isArray(value)) return value.map(live.coloured);
    if (value && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, live.coloured(each)]));
    }
    return value;
  },

  // Text as Plotly takes it, which reads markup.
  text: (words) => words.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;"),

  // The moment [s] that the moving leg shows, and everything that points at it.
  moment: 0,
  show(moment, from) {
    live.moment = moment;
    document.dispatchEvent(new CustomEvent("moment", { detail: { moment, from } }));
  },

  element(name, properties = {}, ...children) {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  },

  svg(name, attributes, ...children) {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  },

  // An entry of a legend: a button that hides and shows what it names.
  entry({ name, colour, width, dashes, hidden, filled }, toggle) {
    const dots = dashes === "dots";
    const looks = `stroke: ${colour}; stroke-width: ${Math.max(width + 0.6, 1.8)}; stroke-dasharray: ${dots ? "none" : dashes}; stroke-dashoffset: ${parseFloat(dashes) / 2 || 0}`;
    const mark = dots ? live.svg("circle", { cx: 13, cy: 5, r: 3.6, fill: filled ? colour : "none", style: looks })
      : live.svg("line", { x1: 0, x2: 26, y1: 5, y2: 5, style: looks });
    const button = live.element("button", { type: "button", className: "entry", ariaPressed: String(!hidden) },
      live.svg("svg", { viewBox: "0 0 26 10", "aria-hidden": "true" }, mark), live.element("span", { textContent: name }));
    button.onclick = () => {
      const shown = button.ariaPressed !== "true";
      button.ariaPressed = String(shown);
      toggle(shown);
    };
    return button;
  },

  // Draw each figure that is near the screen at once, then the others one after another, and any
  // that is about to be seen before its turn. The first need no frame: a browser that takes a
  // picture without showing the page makes none until then. Plotly is unpacked at once: a page may
  // be printed before one of its plots is near the screen, and printing does not wait.
  async start() {
    const figures = Object.keys(live.figures).map((name) => document.getElementById(name));
    for (const figure of figures) { // as high as they will be, before any is drawn
      const description = live.figures[figure.id];
      if (description.kind === "plot") figure.querySelector(".live").style.minHeight = `${live.roomOf(description).height}px`;
    }
    const near = (figure) => {
      const { top, bottom } = figure.getBoundingClientRect();
      return top < innerHeight + live.MARGIN && bottom > -live.MARGIN;
    };
    if (document.getElementById("plotly")) live.library();
    const all = () => figures.forEach(live.enliven);
    addEventListener("beforeprint", all);
    matchMedia("print").addEventListener("change", all);
    const first = figures.filter(near);
    await Promise.all(first.map(live.enliven));
    const watch = new IntersectionObserver((seen) => {
      for (const entry of seen.filter((each) => each.isIntersecting)) live.enliven(entry.target);
    }, { rootMargin: `${live.MARGIN}px` });
    figures.forEach((figure) => watch.observe(figure));
    for (const figure of figures.slice(0, live.MOST)) {
      await new Promise((done) => setTimeout(done, live.PAUSE));
      await live.enliven(figure);
    }
  },

  async enliven(figure) {
    if (figure.classList.contains("alive")) return;
    const description = live.figures[figure.id], place = figure.querySelector(".live");
    figure.classList.add("alive");
    try {
      await live.kinds[description.kind](place, description);
      figure.dataset.drawn = "";
    } catch (error) {
      live.errors.push(String(error));
      place.replaceChildren("This browser cannot draw the figure.");
      console.error(error);
    }
  },
};

document.addEventListener("DOMContentLoaded", live.start);
