"use strict";

const find = (selector) => document.querySelector(selector);
const all = (selector) => [...document.querySelectorAll(selector)];
const within = (low, value, high) => Math.min(Math.max(value, low), high);

// ---- videos: one state moves all panels ----------------------------------------------------------------------------

function player(panels) {
  const FRAMES_PER_SECOND = 6;
  const CLOSEST = 16;
  const state = { frame: 0, view: 0, against: -1, zoom: 1, x: 0, y: 0 };  // x, y: shift in per cent of a panel
  const views = panels[0].frames.length, frames = panels[0].frames[0].length;
  const grid = find("#panels"), canvases = all("#panels canvas");
  const { width, height } = canvases[0];
  const decoded = new Map();
  let wanted = 0, timer = null;

  function picture(panel, view, frame) {
    const key = `${panel} ${view} ${frame}`;
    if (!decoded.has(key)) {
      const image = new Image();
      image.src = panels[panel].frames[view][frame];
      decoded.set(key, image.decode().then(() => image));
    }
    return decoded.get(key);
  }

  async function draw() {
    const ticket = ++wanted;
    const { view, frame, against } = state;
    const images = await Promise.all(panels.map((_, panel) => picture(panel, view, frame)));
    if (ticket !== wanted) return;  // another frame was requested meanwhile
    const base = against < 0 ? null : pixels(images[against]);
    canvases.forEach((canvas, panel) => {
      const context = canvas.getContext("2d");
      if (base) context.putImageData(difference(pixels(images[panel]), base), 0, 0);
      else context.drawImage(images[panel], 0, 0, width, height);
    });
    grid.dataset.shown = `${view} ${frame} ${against}`;
    panels.forEach((_, panel) => picture(panel, view, (frame + 1) % frames));
  }

  function show(change) {
    Object.assign(state, change);
    find("#frame").value = state.frame + 1;
    find("#where").textContent = `${state.frame + 1} of ${frames}`;
    find("#against").value = state.against;
    if (find("#view")) find("#view").value = state.view;
    find("#legend").hidden = state.against < 0;
    all("#panels .figure").forEach((element, panel) => {
      const value = panels[panel].psnr[state.view];
      element.textContent = value === undefined ? "" : `${value.toFixed(2)} dB`;
    });
    draw();
  }

  const scratch = Object.assign(document.createElement("canvas"), { width, height }).getContext("2d", { willReadFrequently: true });

  function pixels(image) {
    scratch.drawImage(image, 0, 0, width, height);
    return scratch.getImageData(0, 0, width, height);
  }

  const colours = colourMap(getComputedStyle(document.documentElement).getPropertyValue("--colours"));

  function difference(a, b) {
    const map = new ImageData(width, height);
    const pixels = new Uint32Array(map.data.buffer);  // four bytes at a time
    for (let i = 0; i < pixels.length; i++) pixels[i] = colours[Math.min(4 * Math.abs(a.data[4 * i] - b.data[4 * i]), 255)];
    return map;
  }

  function play(on) {
    clearInterval(timer);
    timer = on ? setInterval(() => show({ frame: (state.frame + 1) % frames }), 1000 / FRAMES_PER_SECOND) : null;
    find("#play").textContent = on ? "Pause" : "Play";
    find("#play").setAttribute("aria-pressed", String(on));
  }

  const step = (count) => show({ frame: (state.frame + count + frames) % frames });
  const nextView = () => show({ view: (state.view + 1) % views });
  const toggleError = () => show({ against: state.against < 0 ? 0 : -1 });

  // zoom about a point, given in per cent of a panel
  function zoom(factor, px = 50, py = 50) {
    const closer = within(1, state.zoom * factor, CLOSEST);
    move(px - ((px - state.x) * closer) / state.zoom, py - ((py - state.y) * closer) / state.zoom, closer);
  }

  function move(x, y, closer = state.zoom) {
    state.zoom = closer;
    state.x = within(100 * (1 - closer), x, 0);
    state.y = within(100 * (1 - closer), y, 0);
    for (const key of ["zoom", "x", "y"]) grid.style.setProperty(`--${key}`, state[key]);
    grid.classList.toggle("zoomed", closer > 1);
  }

  function place(event) {
    const box = (event.target.closest(".window") ?? grid.querySelector(".window")).getBoundingClientRect();
    return [(100 * (event.clientX - box.left)) / box.width, (100 * (event.clientY - box.top)) / box.height, box];
  }

  const fingers = new Map();
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
  };

  grid.addEventListener("pointerdown", (event) => {
    if (!event.target.closest(".window")) return;
    event.target.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
  });
  grid.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const [px, py, box] = place(event);
    if (fingers.size === 1) {
      const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
      move(state.x + (100 * dx) / box.width, state.y + (100 * dy) / box.height);
      fingers.set(event.pointerId, event);
    } else {
      const wide = spread();
      fingers.set(event.pointerId, event);
      if (wide > 0) zoom(spread() / wide, px, py);
    }
  });
  for (const end of ["pointerup", "pointercancel"]) {
    grid.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
  grid.addEventListener("dblclick", (event) => {
    if (!event.target.closest(".window")) return;
    const [px, py] = place(event);
    zoom(state.zoom > 1 ? 1 / state.zoom : 3, px, py);
  });
  grid.addEventListener("wheel", (event) => {
    if (!event.ctrlKey || !event.target.closest(".window")) return;  // else scroll the page
    event.preventDefault();
    const [px, py] = place(event);
    zoom(Math.exp(-event.deltaY / 300), px, py);
  }, { passive: false });

  find("#frame").addEventListener("input", (event) => show({ frame: Number(event.target.value) - 1 }));
  find("#view")?.addEventListener("input", (event) => show({ view: Number(event.target.value) }));
  find("#against").addEventListener("input", (event) => show({ against: Number(event.target.value) }));
  find("#play").addEventListener("click", () => play(timer === null));
  find("#closer").addEventListener("click", () => zoom(1.5));
  find("#farther").addEventListener("click", () => zoom(1 / 1.5));
  find("#whole").addEventListener("click", () => move(0, 0, 1));

  const keys = {
    ArrowLeft: () => step(-1), ArrowRight: () => step(1), " ": () => play(timer === null),
    v: nextView, e: toggleError, "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: () => move(0, 0, 1),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in keys)) return;
    const typing = event.target.closest("select, button, summary, pre, .scroll");
    const sliding = event.target.closest("input") && event.key.startsWith("Arrow");  // the slider handles its arrow keys
    if (typing || sliding) return;
    event.preventDefault();
    keys[event.key]();
  });

  show({});
}

// 256 colours interpolated in a list such as "rgb(0 0 4), rgb(81 18 124)", each as four bytes: red, green, blue, alpha
function colourMap(list) {
  const stops = list.match(/rgb\([^)]*\)/g).map((text) => text.match(/\d+/g).map(Number));
  const bytes = Array.from({ length: 256 }, (_, level) => {
    const at = (level / 255) * (stops.length - 1);
    const from = Math.min(Math.floor(at), stops.length - 2);
    return [...stops[from].map((value, i) => value + (stops[from + 1][i] - value) * (at - from)), 255];
  });
  return new Uint32Array(Uint8ClampedArray.from(bytes.flat()).buffer);
}

// ---- table: sorted by the clicked column, missing values last -------------------------------------------------------

function sortable(table) {
  const headings = [...table.tHead.rows[0].cells];
  const body = table.tBodies[0];

  function sort(column, order) {
    headings.forEach((heading) => heading.removeAttribute("aria-sort"));
    headings[column].setAttribute("aria-sort", order);
    const value = (row) => row.cells[column]?.dataset.value ?? "";
    const sign = order === "ascending" ? 1 : -1;
    const rows = [...body.rows].sort((a, b) => {
      const [first, second] = [value(a), value(b)];
      if (first === "" || second === "") return (first === "") - (second === "");
      const numbers = Number(first) - Number(second);
      return sign * (Number.isNaN(numbers) ? first.localeCompare(second) : numbers);
    });
    body.append(...rows);
  }

  headings.forEach((heading, column) => {
    const first = heading.querySelector("button").dataset.first;
    const other = first === "ascending" ? "descending" : "ascending";
    heading.addEventListener("click", () => sort(column, heading.getAttribute("aria-sort") === first ? other : first));
  });
  sort(1, "descending");  // PSNR, or the score without truth
}

// ---- plot: a tooltip for each point, and its row in the table -------------------------------------------------------

function hover(plot) {
  const tip = plot.querySelector(".tip");

  function light(point, on) {
    const row = all("#table tbody tr").find((one) => one.dataset.name === point.dataset.name);
    row.classList.toggle("lit", on);
    tip.hidden = !on;
    if (!on) return;
    tip.textContent = point.dataset.words;
    const dot = point.querySelector(".dot").getBoundingClientRect(), box = plot.getBoundingClientRect();
    const half = tip.offsetWidth / 2;
    tip.style.left = `${within(half, dot.left + dot.width / 2 - box.left, Math.max(box.width - half, half))}px`;
    tip.style.top = `${dot.top + dot.height / 2 - box.top}px`;
  }

  plot.querySelectorAll(".point").forEach((point) => {
    for (const event of ["pointerenter", "focus"]) point.addEventListener(event, () => light(point, true));
    for (const event of ["pointerleave", "blur"]) point.addEventListener(event, () => light(point, false));
  });
}

const data = find("#data");
if (data) player(JSON.parse(data.textContent));
sortable(find("#table"));
const plot = find(".plot");
if (plot) hover(plot);
