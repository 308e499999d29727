// What joints do at the moment that a time slider chooses, in numbers. The plots of the page follow.
"use strict";

live.kinds.moment = async (place, { joints, kinds, period, samples }) => {
  const { element } = live;
  const end = (samples - 1) * period;
  const slider = element("input", { type: "range", min: 0, max: samples - 1, step: 1, value: 0, ariaLabel: "time" });
  const clock = element("output", { className: "clock" });
  const play = element("button", { type: "button", className: "play" });
  const cells = joints.map(() => kinds.map(() => element("td")));
  const head = element("tr", {}, element("th", { scope: "col", textContent: "joint" }),
    ...kinds.map(({ name }) => element("th", { scope: "col", textContent: name })));
  const rows = joints.map(({ name, unit }, j) => element("tr", {},
    element("th", { scope: "row", textContent: `${name} [${unit}]` }), ...cells[j]));
  place.append(
    element("div", { className: "controls" }, play, slider, clock),
    element("div", { className: "scroll" }, element("table", {}, element("thead", {}, head), element("tbody", {}, ...rows))));

  let moment = 0, playing = false, last = null;
  function draw() {
    const sample = Math.min(Math.round(moment / period), samples - 1);
    kinds.forEach(({ values }, k) => joints.forEach((_, j) => {
      const value = values[j] === null ? null : values[j][sample];
      cells[j][k].textContent = value === null ? "–" : value.toFixed(2).replace("-", "−");
    }));
    slider.value = sample;
    clock.textContent = end < 10 ? `${Math.round(1000 * moment)} ms` : `${moment.toFixed(2)} s`;
  }
  function set(now) {
    if (now && moment >= end) live.show(0, place);
    [playing, last] = [now, null];
    play.textContent = now ? "❚❚" : "▶";
    play.ariaLabel = now ? "pause" : "play";
    if (now) requestAnimationFrame(run);
  }
  function run(now) {
    if (!playing) return;
    const next = moment + (now - (last ?? now)) / 1000;
    last = now;
    if (next >= end) set(false);
    live.show(Math.min(next, end), place);
    requestAnimationFrame(run);
  }
  play.onclick = () => set(!playing);
  slider.oninput = () => { set(false); live.show(slider.value * period, place); };
  document.addEventListener("moment", ({ detail }) => {
    moment = Math.min(Math.max(detail.moment, 0), end);
    if (detail.from !== place) set(false);
    draw();
  });
  set(false);
  draw();
};
