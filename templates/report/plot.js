// Draws charts on canvases: panels that share one horizontal axis, with zoom and pan.
'use strict';

const COLORS = ['c1', 'c2', 'c3', 'c4', 'c5', 'c6', 'c7'];
const AXIS = 72, RIGHT = 12, GAP = 12, TICKS = 34, TOP = 8;
const charts = [];

/** The numbers of an array of the page: base64 of little-endian single precision, from a base if there is one, or a list. */
function numbers(array) {
  if (!array) return null;
  if (Array.isArray(array)) return Float64Array.from(array, (v) => (v === null ? NaN : v));
  if (array.decoded) return array.decoded;
  const text = atob(array.f32);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const single = new Float32Array(bytes.buffer);
  array.decoded = array.base ? Float64Array.from(single, (v) => v + array.base) : single;
  return array.decoded;
}

/** Where the values of a series stand: evenly spaced, or at numbers of their own. */
function positions(x) {
  if (x && x.step !== undefined) return {at: (i) => x.start + i * x.step, even: x};
  const known = x instanceof Float64Array ? x : numbers(x);
  return {at: (i) => known[i], known};
}

function number(value, digits = 5) {
  if (!Number.isFinite(value)) return '–';
  const text = Number(value.toPrecision(digits));
  const size = Math.abs(text);
  return size !== 0 && (size < 1e-4 || size >= 1e7) ? text.toExponential() : String(text);
}

function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const rough = span / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= rough * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k++) found.push(k * step);
  return found;
}

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

class Chart {
  /** `spec`: {label, xlabel, panels: [{label, height, log, series, lines}]}; see report/README. */
  constructor(place, spec) {
    this.place = place;
    this.hidden = new Set();
    this.build();
    this.show(spec);
    charts.push(this);
    new ResizeObserver(() => this.draw()).observe(this.canvas.parentElement);
  }

  build() {
    this.canvas = element('canvas', {tabindex: '0', role: 'img'});
    this.legend = element('ul', {class: 'legend'});
    this.readout = element('p', {class: 'readout'});
    const button = (text, label, action) => {
      const made = element('button', {type: 'button', 'aria-label': label, title: label}, text);
      made.addEventListener('click', action);
      return made;
    };
    const bar = element('div', {class: 'tools'},
      button('+', 'Zoom in', () => this.zoom(0.5)), button('−', 'Zoom out', () => this.zoom(2)),
      button('‹', 'Move left', () => this.pan(-0.25)), button('›', 'Move right', () => this.pan(0.25)),
      button('All', 'Show all', () => this.reset()));
    this.place.replaceChildren(element('div', {class: 'chart-head'}, this.legend, bar),
      element('div', {class: 'canvas'}, this.canvas), this.readout);
    this.canvas.addEventListener('keydown', (e) => this.key(e));
    this.canvas.addEventListener('wheel', (e) => {
      if (!e.ctrlKey && !e.metaKey && document.activeElement !== this.canvas) return;
      e.preventDefault();
      this.zoom(e.deltaY > 0 ? 1.25 : 0.8, this.fraction(e.offsetX));
    }, {passive: false});
    this.canvas.addEventListener('pointerdown', (e) => this.down(e));
    this.canvas.addEventListener('pointermove', (e) => this.move(e));
    this.canvas.addEventListener('pointerup', (e) => this.up(e));
    this.canvas.addEventListener('pointercancel', () => { this.drag = null; this.draw(); });
    this.canvas.addEventListener('pointerleave', () => { if (!this.drag) { this.cursor = null; this.draw(); } });
    this.canvas.addEventListener('dblclick', () => this.reset());
  }

  show(spec, keepsView = false) {
    this.spec = spec;
    this.canvas.setAttribute('aria-label', spec.label);
    for (const panel of spec.panels) {
      for (const series of panel.series) {
        series.y = series.y && series.y.length !== undefined && !Array.isArray(series.y) ? series.y : numbers(series.y);
        if (series.low) { series.low = numbers(series.low); series.high = numbers(series.high); }
        series.where = positions(series.x || spec.x);
      }
    }
    this.listed();
    if (!keepsView || !this.view) this.reset(); else this.draw();
  }

  listed() {
    const seen = new Map();
    for (const panel of this.spec.panels) {
      for (const series of panel.series) if (!series.unlisted) seen.set(series.name, series.color);
    }
    this.legend.replaceChildren(...[...seen].map(([name, color]) => {
      const pressed = !this.hidden.has(name);
      const swatch = element('span', {class: `swatch ${color}`, 'aria-hidden': 'true'});
      const made = element('button', {type: 'button', 'aria-pressed': String(pressed)}, swatch, name);
      made.addEventListener('click', () => {
        if (!this.hidden.delete(name)) this.hidden.add(name);
        made.setAttribute('aria-pressed', String(!this.hidden.has(name)));
        this.draw();
      });
      return element('li', {}, made);
    }));
  }

  bounds() {
    let low = Infinity, high = -Infinity;
    for (const panel of this.spec.panels) {
      for (const series of panel.series) {
        const count = (series.y || series.low).length;
        if (!count) continue;
        const ends = series.where.known ? extent(series.where.known, 0, count) : [series.where.at(0), series.where.at(count - 1)];
        low = Math.min(low, ends[0]);
        high = Math.max(high, ends[1]);
      }
    }
    if (!(high > low)) { low = Number.isFinite(low) ? low - 0.5 : 0; high = low + 1; }
    return this.spec.padded ? [low - 0.03 * (high - low), high + 0.03 * (high - low)] : [low, high];
  }

  reset() { this.view = this.bounds(); this.draw(); }

  zoom(factor, about = 0.5) {
    const [low, high] = this.view, span = (high - low) * factor, all = this.bounds();
    if (span < (all[1] - all[0]) * 1e-6) return;
    const at = low + about * (high - low);
    this.look(at - about * span, at + (1 - about) * span);
  }

  pan(share) {
    const span = this.view[1] - this.view[0];
    this.look(this.view[0] + share * span, this.view[1] + share * span);
  }

  look(low, high) {
    const [first, last] = this.bounds(), span = Math.min(high - low, last - first);
    low = Math.min(Math.max(low, first), last - span);
    this.view = [low, low + span];
    this.draw();
  }

  key(event) {
    const action = {'+': () => this.zoom(0.5), '=': () => this.zoom(0.5), '-': () => this.zoom(2),
      ArrowLeft: () => this.pan(-0.25), ArrowRight: () => this.pan(0.25), Home: () => this.reset(), 0: () => this.reset()}[event.key];
    if (action) { event.preventDefault(); action(); }
  }

  fraction(offset) { return Math.min(Math.max((offset - AXIS) / Math.max(this.width - AXIS - RIGHT, 1), 0), 1); }
  place_of(offset) { return this.view[0] + this.fraction(offset) * (this.view[1] - this.view[0]); }

  down(event) {
    if (event.button !== 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    const pans = event.pointerType === 'touch' || event.shiftKey;
    this.drag = {from: event.offsetX, to: event.offsetX, pans, view: [...this.view]};
  }

  move(event) {
    this.cursor = event.offsetX;
    if (this.drag) {
      this.drag.to = event.offsetX;
      if (this.drag.pans) {
        const [low, high] = this.drag.view;
        const by = (this.drag.from - event.offsetX) / Math.max(this.width - AXIS - RIGHT, 1) * (high - low);
        this.look(low + by, high + by);
        return;
      }
    }
    this.draw();
  }

  up() {
    const drag = this.drag;
    this.drag = null;
    if (drag && !drag.pans && Math.abs(drag.to - drag.from) > 5) {
      const ends = [this.place_of(drag.from), this.place_of(drag.to)].sort((a, b) => a - b);
      this.look(...ends);
    } else this.draw();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.paint(); });
  }

  paint() {
    const width = this.canvas.parentElement.clientWidth;
    if (!width) return;
    const heights = this.spec.panels.map((p) => p.height || 170);
    const height = heights.reduce((a, b) => a + b + GAP, -GAP) + TICKS + TOP;
    const ratio = window.devicePixelRatio || 1;
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
      this.canvas.style.width = `${width}px`;
      this.canvas.style.height = `${height}px`;
    }
    this.width = width;
    const style = getComputedStyle(document.documentElement);
    this.color = (name) => style.getPropertyValue(`--${name}`).trim() || '#888';
    const g = this.canvas.getContext('2d');
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    g.font = `12px ${style.getPropertyValue('--font') || 'sans-serif'}`;
    const box = {left: AXIS, right: width - RIGHT, x: (v) => AXIS + (v - this.view[0]) / (this.view[1] - this.view[0]) * (width - AXIS - RIGHT)};
    let top = TOP;
    const xticks = ticks(...this.view, Math.max((width - AXIS) / 90, 2));
    this.spec.panels.forEach((panel, i) => {
      this.paint_panel(g, panel, {...box, top, bottom: top + heights[i]}, xticks);
      top += heights[i] + GAP;
    });
    const base = top - GAP;
    g.fillStyle = this.color('muted');
    g.textAlign = 'center';
    g.textBaseline = 'top';
    for (const tick of xticks) {
      const text = number(tick);
      // whole: 1200000 without its last digit is another number
      g.fillText(text, clamp(box.x(tick), AXIS, width - g.measureText(text).width / 2 - 1), base + 4);
    }
    g.fillText(this.spec.xlabel, (box.left + box.right) / 2, base + 19);
    this.paint_drag(g, box, base);
    this.say();
  }

  paint_drag(g, box, base) {
    if (this.drag && !this.drag.pans) {
      const [a, b] = [this.drag.from, this.drag.to].map((v) => clamp(v, box.left, box.right));
      g.globalAlpha = 0.15;
      g.fillStyle = this.color('accent');
      g.fillRect(Math.min(a, b), TOP, Math.abs(b - a), base - TOP);
      g.globalAlpha = 1;
    } else if (this.cursor !== null && this.cursor >= box.left && this.cursor <= box.right) {
      g.strokeStyle = this.color('muted');
      g.globalAlpha = 0.6;
      line(g, this.cursor, TOP, this.cursor, base);
      g.globalAlpha = 1;
    }
  }

  shown(panel) { return panel.series.filter((s) => !this.hidden.has(s.name)); }

  paint_panel(g, panel, box, xticks) {
    let [low, high] = this.value_range(panel);
    const log = panel.log && low > 0;
    const scale = log ? Math.log10 : (v) => v;
    const [from, to] = [scale(low), scale(high)];
    const y = (v) => box.bottom - (scale(v) - from) / (to - from) * (box.bottom - box.top);
    g.strokeStyle = this.color('grid');
    g.lineWidth = 1;
    const rows = log ? decades(low, high) : ticks(low, high, (box.bottom - box.top) / 30);
    for (const tick of rows) line(g, box.left, y(tick), box.right, y(tick));
    for (const tick of xticks) line(g, box.x(tick), box.top, box.x(tick), box.bottom);
    g.fillStyle = this.color('muted');
    g.textAlign = 'right';
    g.textBaseline = 'middle';
    for (const tick of rows) g.fillText(number(tick, 4), box.left - 6, clamp(y(tick), box.top + 5, box.bottom - 5));
    g.save();
    g.beginPath();
    g.rect(box.left, box.top, box.right - box.left, box.bottom - box.top);
    g.clip();
    for (const series of this.shown(panel)) this.paint_series(g, series, box, y);
    for (const limit of panel.lines || []) this.paint_limit(g, limit, box, y);
    g.restore();
    g.save();
    g.translate(8, (box.top + box.bottom) / 2);
    g.rotate(-Math.PI / 2);
    g.textAlign = 'center';
    g.fillStyle = this.color('text');
    g.fillText(fitting(g, panel.label, box.bottom - box.top + GAP - 2), 0, 0);
    g.restore();
  }

  paint_limit(g, limit, box, y) {
    g.strokeStyle = this.color(limit.color || 'limit');
    g.setLineDash(limit.solid ? [] : [6, 4]);
    if (limit.y !== undefined) line(g, box.left, y(limit.y), box.right, y(limit.y));
    else line(g, box.x(limit.x), box.top, box.x(limit.x), box.bottom);
    g.setLineDash([]);
    if (!limit.label || box.bottom - box.top < 100) return;
    g.fillStyle = this.color(limit.color || 'limit');
    const late = limit.y === undefined && box.x(limit.x) > box.right - 60;
    g.textAlign = limit.y !== undefined || late ? 'right' : 'left';
    const at = limit.y !== undefined ? [box.right - 4, y(limit.y) + (limit.below ? -8 : 9)] : [box.x(limit.x) + (late ? -4 : 4), box.top + 9];
    g.fillText(limit.label, ...at);
  }

  visible(series) {
    const count = (series.y || series.low).length, {even, known} = series.where;
    if (even) {
      const first = Math.floor((this.view[0] - even.start) / even.step) - 1;
      const last = Math.ceil((this.view[1] - even.start) / even.step) + 1;
      return [clamp(first, 0, count), clamp(last + 1, 0, count)];
    }
    if (series.unsorted) return [0, count];
    return [clamp(below(known, this.view[0]) - 1, 0, count), clamp(below(known, this.view[1]) + 2, 0, count)];
  }

  value_range(panel) {
    let low = Infinity, high = -Infinity;
    const take = (values, a, b) => { const [l, h] = extent(values, a, b); low = Math.min(low, l); high = Math.max(high, h); };
    for (const series of this.shown(panel)) {
      const [a, b] = this.visible(series);
      if (series.low) { take(series.low, a, b); take(series.high, a, b); } else take(series.y, a, b);
    }
    const spread = high - low;
    for (const limit of panel.lines || []) {
      if (limit.y === undefined) continue;
      const near = !limit.far || (limit.y > low - 0.6 * spread && limit.y < high + 0.6 * spread);
      if (near) { low = Math.min(low, limit.y); high = Math.max(high, limit.y); }
    }
    if (panel.zero) { low = Math.min(low, 0); high = Math.max(high, 0); }
    if (!Number.isFinite(low)) return [0, 1];
    if (!(high > low)) { const by = Math.abs(low) * 0.1 || 1; return panel.log && low > 0 ? [low / 2, low * 2] : [low - by, high + by]; }
    if (panel.log && low > 0) return [low / 1.15, high * 1.15];
    const by = 0.06 * (high - low);
    return [low - by, high + by];
  }

  paint_series(g, series, box, y) {
    const [a, b] = this.visible(series), at = series.where.at;
    g.strokeStyle = g.fillStyle = this.color(series.color);
    g.lineWidth = series.thick ? 4 : series.wide ? 2 : 1.4;
    if (series.low) return void paint_band(g, series, a, b, box, y, at);
    if (series.kind === 'stem') {
      for (let i = a; i < b; i++) {
        if (!Number.isFinite(series.y[i])) continue;
        const x = box.x(at(i));
        line(g, x, y(0), x, y(series.y[i]));
        g.beginPath();
        g.arc(x, y(series.y[i]), 3, 0, 7);
        g.fill();
      }
    } else if (series.kind === 'dots' && b - a < (box.right - box.left)) {
      const size = b - a < 200 ? 2.2 : 1.4;
      for (let i = a; i < b; i++) {
        if (!Number.isFinite(series.y[i])) continue;
        g.beginPath();
        g.arc(box.x(at(i)), y(series.y[i]), size, 0, 7);
        g.fill();
      }
    } else if (b - a > 3 * (box.right - box.left) && !series.unsorted) paint_thinned(g, series.y, a, b, box, y, at);
    else paint_line(g, series.y, a, b, box, y, at, series.kind === 'dots', series.held);
  }

  say() {
    if (this.cursor === null || this.cursor === undefined || this.drag) { this.readout.textContent = this.spec.note || ''; return; }
    const x = this.place_of(this.cursor), parts = [`${this.spec.xlabel}: ${number(x, 6)}`];
    for (const panel of this.spec.panels) {
      for (const series of this.shown(panel)) {
        if (series.unlisted || series.unsorted || !series.y) continue;
        const {even, known} = series.where;
        const i = even ? Math.round((x - even.start) / even.step) : nearest(known, x);
        if (i >= 0 && i < series.y.length) parts.push(`${series.label || series.name} ${number(series.y[i])}`);
      }
    }
    this.readout.textContent = parts.join('   ');
  }
}

function clamp(v, low, high) { return Math.min(Math.max(v, low), high); }

function extent(values, a, b) {
  let low = Infinity, high = -Infinity;
  for (let i = a; i < b; i++) {
    const v = values[i];
    if (v < low) low = v;
    if (v > high) high = v;
  }
  return Number.isFinite(low) && Number.isFinite(high) ? [low, high] : [Infinity, -Infinity];
}

function below(sorted, x) {
  let a = 0, b = sorted.length;
  while (a < b) { const m = (a + b) >> 1; if (sorted[m] < x) a = m + 1; else b = m; }
  return a;
}

function nearest(sorted, x) {
  const i = below(sorted, x);
  return i > 0 && (i === sorted.length || x - sorted[i - 1] < sorted[i] - x) ? i - 1 : i;
}

function decades(low, high) {
  const found = [], factors = Math.log10(high / low) < 1.5 ? [1, 2, 5] : [1];
  for (let p = Math.floor(Math.log10(low)); p <= Math.ceil(Math.log10(high)); p++) {
    for (const f of factors) { const v = f * 10 ** p; if (v >= low && v <= high) found.push(v); }
  }
  return found.length > 9 ? found.filter((_, i) => i % Math.ceil(found.length / 8) === 0) : found;
}

function fitting(g, text, room) {
  if (g.measureText(text).width <= room) return text;
  while (text.length > 4 && g.measureText(`${text}…`).width > room) text = text.slice(0, -1);
  return `${text}…`;
}

function line(g, x1, y1, x2, y2) { g.beginPath(); g.moveTo(x1, y1); g.lineTo(x2, y2); g.stroke(); }

/** From value to value; a held one stands until the next, as a model reads it. */
function paint_line(g, values, a, b, box, y, at, dashed, held) {
  let open = false;
  g.beginPath();
  for (let i = a; i < b; i++) {
    if (!Number.isFinite(values[i])) { open = false; continue; }
    const x = box.x(at(i)), v = y(values[i]);
    if (open && held) g.lineTo(x, y(values[i - 1]));
    if (open) g.lineTo(x, v);
    else if (Number.isFinite(values[i + 1])) g.moveTo(x, v);
    else dot(g, x, v);
    open = true;
  }
  if (dashed) g.setLineDash([2, 2]);
  g.stroke();
  g.setLineDash([]);
}

/** A value between gaps, of which a line shows nothing. */
function dot(g, x, y) {
  g.moveTo(x + 0.6, y);
  g.arc(x, y, 0.6, 0, 7);
}

/** Lowest and highest of what shares a column of pixels: no peak is lost. */
function paint_thinned(g, values, a, b, box, y, at) {
  let column = null, begun = null, low = 0, high = 0, first = 0, last = 0;
  g.beginPath();
  const flush = () => { if (column !== null) { g.lineTo(column, y(first)); g.lineTo(column, y(low)); g.lineTo(column, y(high)); g.lineTo(column, y(last)); } };
  for (let i = a; i < b; i++) {
    const v = values[i];
    if (!Number.isFinite(v)) {
      flush();
      if (column !== null && column === begun && low === high) dot(g, column, y(low));
      column = begun = null;
      continue;
    }
    const x = Math.round(box.x(at(i)));
    if (x !== column) {
      flush();
      if (column === null) {
        g.moveTo(x, y(v));
        begun = x;
      }
      column = x;
      low = high = first = v;
    }
    if (v < low) low = v;
    if (v > high) high = v;
    last = v;
  }
  flush();
  g.stroke();
}

function paint_band(g, series, a, b, box, y, at) {
  g.globalAlpha = series.alpha || 0.18;
  g.beginPath();
  for (let i = a; i < b; i++) g.lineTo(box.x(at(i)), y(series.low[i]));
  for (let i = b - 1; i >= a; i--) g.lineTo(box.x(at(i)), y(series.high[i]));
  g.closePath();
  g.fill();
  g.globalAlpha = series.edged ? 0.8 : 0;
  if (series.edged) g.stroke();
  g.globalAlpha = 1;
}
