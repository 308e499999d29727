// The moving leg: lines from joint to joint, seen from any side, with a time slider. Positions are
// in centimetres, x forward, y to the left, z up; the view turns about z, then tilts.
"use strict";

live.kinds.leg = async (place, { motions, period, cyclic, ground }) => {
  const WIDTH = 600, HEIGHT = 400, MARGIN = 40;
  const VIEWS = { side: [0, 0], front: [90, 0], top: [0, 90], oblique: [-35, 20] };
  const samples = motions[0].points.length;
  const end = (cyclic ? samples : samples - 1) * period;
  const state = { moment: 0, turn: 0, tilt: 0, playing: false, speed: 0.25 };
  const { element, svg } = live;

  // The view is fitted to the whole motion when it is chosen, and keeps its scale while it turns.
  const all = motions.flatMap((motion) => motion.points.flat());
  const range = (values) => [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))];
  const ends = [0, 1, 2].map((k) => range(all.map((point) => point[k])));
  const middle = ends.map(([low, high]) => (low + high) / 2);
  const [[left, right], [near, far]] = ends;
  const corners = ground === null ? [] : [[left, near, ground], [right, near, ground], [right, far, ground], [left, far, ground]];
  all.push(...corners);
  const turned = (point) => {
    const [x, y, z] = point.map((value, k) => value - middle[k]);
    const [a, b] = [state.turn, state.tilt].map((degrees) => (degrees * Math.PI) / 180);
    const deep = y * Math.cos(a) - x * Math.sin(a);
    return [x * Math.cos(a) + y * Math.sin(a), -z * Math.cos(b) - deep * Math.sin(b)];
  };
  const seen = (point) => turned(point).map((value, k) =>
    [WIDTH, HEIGHT][k] / 2 + state.scale * (value - state.centre[k]));
  const fit = () => {
    const spans = [0, 1].map((k) => range(all.map((point) => turned(point)[k])));
    state.centre = spans.map(([low, high]) => (low + high) / 2);
    const scales = spans.map(([low, high], k) => ([WIDTH, HEIGHT][k] - 2 * MARGIN) / (high - low));
    state.scale = Math.min(...scales.filter(Number.isFinite), 1e6);
  };
  const line = (points) => points.map((point) => seen(point).map((value) => value.toFixed(1)).join()).join(" ");
  const at = ({ points }, moment) => {
    const sample = Math.min(moment / period, cyclic ? samples : samples - 1);
    const before = Math.floor(sample), share = sample - before;
    const from = points[before % samples];
    const to = points[cyclic ? (before + 1) % samples : Math.min(before + 1, samples - 1)];
    return from.map((point, j) => point.map((value, k) => value + share * (to[j][k] - value)));
  };

  const floor = svg("polygon", { class: "floor" });
  const drawn = motions.map((motion) => {
    const stroke = `stroke: ${motion.colour}`;
    const path = svg("polyline", { class: "path", style: `${stroke}; stroke-width: ${motion.width}; stroke-dasharray: ${motion.dashes}` });
    const bones = svg("polyline", { class: "bones", style: stroke });
    const joints = motion.points[0].map((_, j, every) =>
      svg("circle", { r: j === every.length - 1 ? 6 : 4, style: j === every.length - 1 ? `fill: ${motion.colour}` : stroke }));
    const group = svg("g", {}, path, bones, ...joints);
    const distance = element("output");
    const button = live.entry(motion, (shown) => { motion.hidden = !shown; draw(); });
    button.append(distance);
    return { motion, group, path, bones, joints, button, distance };
  });
  const bar = svg("path", { class: "bar" }), length = svg("text", { x: 22, y: HEIGHT - 22 });
  const picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": "The leg at the moment that the slider chooses", class: "stage" },
    floor, ...drawn.map(({ group }) => group),
    bar, length);

  const slider = element("input", { type: "range", min: 0, max: samples - (cyclic ? 0 : 1), step: "any", value: 0, ariaLabel: "time" });
  const clock = element("output", { className: "clock" });
  const play = element("button", { type: "button", className: "play" });
  const speed = element("select", { ariaLabel: "speed" }, ...[[1, "1×"], [0.5, "½×"], [0.25, "¼×"], [0.1, "⅒×"]].map(([value, text]) => element("option", { value, textContent: text, selected: value === state.speed })));
  const views = Object.keys(VIEWS).map((name) => element("button", { type: "button", textContent: name, onclick: () => { [state.turn, state.tilt] = VIEWS[name]; fit(); draw(); } }));
  place.append(element("div", { className: "entries" }, ...drawn.map(({ button }) => button)), picture,
    element("div", { className: "controls" }, play, slider, clock, speed),
    element("div", { className: "views" }, element("span", { textContent: "seen from the" }), ...views.slice(0, 3), element("span", { textContent: "or" }), views[3]));

  function draw() {
    floor.setAttribute("points", line(corners));
    for (const each of drawn) {
      const { motion } = each;
      each.group.style.display = motion.hidden ? "none" : "";
      const feet = motion.points.map((points) => points[points.length - 1]);
      each.path.setAttribute("points", line(cyclic ? [...feet, feet[0]] : feet));
    }
    const most = (WIDTH / state.scale) * 0.3, power = 10 ** Math.floor(Math.log10(most));
    const centimetres = power * [5, 2, 1].find((factor) => factor * power <= most);
    bar.setAttribute("d", `M16 ${HEIGHT - 20}v6h${(centimetres * state.scale).toFixed(1)}v-6`);
    length.textContent = `${centimetres} cm`;
    views.forEach((button) => button.setAttribute("aria-pressed", String(VIEWS[button.textContent].join() === `${state.turn},${state.tilt}`)));
    pose();
  }

  function pose() {
    for (const { motion, bones, joints, distance } of drawn) {
      const points = at(motion, state.moment);
      bones.setAttribute("points", line(points));
      points.forEach((point, j) => { [joints[j].cx.baseVal.value, joints[j].cy.baseVal.value] = seen(point); });
      const sample = Math.round(state.moment / period) % samples;
      distance.textContent = motion.distances ? `${motion.rms.toFixed(2)} cm rms, now ${motion.distances[sample].toFixed(2)}` : "";
    }
    slider.value = state.moment / period;
    clock.textContent = end < 10 ? `${Math.round(1000 * state.moment)} ms` : `${state.moment.toFixed(2)} s`;
  }

  let last = null;
  function run(now) {
    if (!state.playing) return;
    const next = state.moment + (state.speed * (now - (last ?? now))) / 1000;
    last = now;
    if (!cyclic && next >= end) set(false);
    live.show(next >= end ? (cyclic ? next % end : end) : next, place);
    requestAnimationFrame(run);
  }
  function set(playing) {
    if (playing && !cyclic && state.moment >= end) live.show(0, place);
    Object.assign(state, { playing });
    last = null;
    play.textContent = playing ? "❚❚" : "▶";
    play.ariaLabel = playing ? "pause" : "play";
    if (playing) requestAnimationFrame(run);
  }
  play.onclick = () => set(!state.playing);
  speed.onchange = () => { state.speed = Number(speed.value); };
  slider.oninput = () => { set(false); live.show(slider.value * period, place); };
  document.addEventListener("moment", ({ detail }) => {
    state.moment = Math.min(Math.max(detail.moment, 0), end);
    if (detail.from !== place) set(false);
    pose();
  });
  let from = null;
  picture.onpointerdown = (event) => { from = [event.clientX, event.clientY, state.turn, state.tilt]; picture.setPointerCapture(event.pointerId); };
  picture.onpointermove = (event) => {
    if (!from) return;
    state.turn = from[2] + (event.clientX - from[0]) * 0.5;
    state.tilt = Math.min(Math.max(from[3] + (event.clientY - from[1]) * 0.5, 0), 90);
    draw();
  };
  picture.onpointerup = picture.onpointercancel = () => { from = null; };
  fit();
  set(false);
  draw();
};
