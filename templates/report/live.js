// Runs the model in the page: its C as WebAssembly, with inputs from sliders or a record.
'use strict';

const LIVE = DATA.live;
let bench = null;

class LiveModel {
  constructor(instance) {
    this.calls = instance.exports;
    this.buffer = instance.exports.memory.buffer;
    const Real = LIVE.dtype === 'float64' ? Float64Array : Float32Array;
    this.view = (address, field) => new Real(this.buffer, address + field.offset, field.size);
    this.inputs = LIVE.inputs.map((f) => this.view(this.calls.inputs(), f));
    this.outputs = LIVE.outputs.map((f) => this.view(this.calls.outputs(), f));
    this.starts = LIVE.start.map((f) => this.view(this.calls.start(), f));
  }

  /** How many golden steps give the bits of the interpreter, of how many; whether all else holds. */
  golden() {
    const from = this.calls.golden();
    const bytes = new Uint8Array(this.buffer, from, this.calls.golden_length());
    const lines = new TextDecoder().decode(bytes).split('\n').map((l) => l.trim());
    const wanted = LIVE.expected.split('\n').filter((l) => l !== '');
    const same = wanted.filter((l, i) => l === lines[i]).length;
    const rest = lines[wanted.length] || '';
    return {same, all: wanted.length, agrees: rest === 'differing 00000000 selftest 00000000'};
  }
}

class Bench {
  constructor(model) {
    this.model = model;
    this.playing = false;
    this.chooser = document.getElementById('live-source');
    this.speed = document.getElementById('live-speed');
    this.button = document.getElementById('live-run');
    this.said = document.getElementById('live-status');
    this.sliders = LIVE.inputs.map((field) => this.slider_row(field));
    this.begins = LIVE.start.map((field) => field.begins && this.start_row(field));
    this.button.addEventListener('click', () => this.toggle());
    document.getElementById('live-step').addEventListener('click', () => { this.stop(); this.steps(1); this.show(); });
    document.getElementById('live-reset').addEventListener('click', () => this.restart());
    this.chooser.addEventListener('change', () => this.restart());
    this.restart();
  }

  slider_row(field) {
    const place = document.getElementById('live-inputs');
    const group = element('fieldset', {class: 'live-input'});
    group.append(element('legend', {}, with_unit(field.name, field.unit)));
    const row = {values: new Float64Array(field.elements.length).fill(field.initial), feed: null, knobs: []};
    if (field.doc) group.append(element('p', {class: 'doc'}, field.doc));
    if (field.fed_by !== null) {
      row.feed = element('input', {type: 'checkbox'});
      row.feed.checked = true;
      row.feed.addEventListener('change', () => this.restart());
      group.append(element('label', {class: 'feed'}, row.feed, ` fed back from ${LIVE.outputs[field.fed_by].name}`));
    }
    field.elements.forEach((label, e) => {
      const id = `live-${field.name}-${e}`.replace(/[^A-Za-z0-9_-]/g, '_');
      const knob = element('input', {type: 'range', id, min: field.low, max: field.high, step: 'any'});
      knob.value = field.initial;
      const shown = element('output', {for: id}, number(field.initial, 4));
      const told = element('label', {for: id}, label || 'value');
      knob.addEventListener('input', () => { row.values[e] = Number(knob.value); shown.textContent = number(row.values[e], 4); });
      row.knobs.push({knob, shown});
      group.append(element('div', {class: 'knob'}, told, knob, shown));
    });
    place.append(group);
    return row;
  }

  /** Sliders for the values of a state before the first step. */
  start_row(field) {
    const group = element('fieldset', {class: 'live-input'});
    group.append(element('legend', {}, with_unit(`start of ${field.name}`, field.unit)));
    const row = {values: Float64Array.from(field.begins), knobs: []};
    field.elements.forEach((label, e) => {
      const id = `live-start-${field.name}-${e}`.replace(/[^A-Za-z0-9_-]/g, '_');
      const knob = element('input', {type: 'range', id, min: field.low, max: field.high, step: 'any'});
      const shown = element('output', {for: id});
      knob.addEventListener('input', () => { row.values[e] = Number(knob.value); shown.textContent = number(row.values[e], 4); });
      knob.addEventListener('change', () => this.restart());
      row.knobs.push({knob, shown});
      group.append(element('div', {class: 'knob'}, element('label', {for: id}, label || 'value'), knob, shown));
    });
    document.getElementById('live-inputs').append(group);
    return row;
  }

  /** Where a state starts: as the record shown does, else where its sliders are. */
  begin(view, field, row) {
    const known = this.record && this.record.starts;
    field.names.forEach((name, e) => {
      const value = known && known[name] !== undefined && known[name] !== null ? known[name] : row.values[e];
      const {knob, shown} = row.knobs[e];
      view[e] = value;
      knob.value = value;
      knob.disabled = this.record !== null;
      shown.textContent = number(value, 4);
    });
  }

  get record() { return this.chooser.value === '' ? null : DATA.records[Number(this.chooser.value)]; }

  restart() {
    this.stop();
    this.at = 0;
    this.fed = new Map();
    this.bits = 0;
    this.series = {inputs: LIVE.inputs.map((f) => f.elements.map(() => [])), outputs: LIVE.outputs.map((f) => f.elements.map(() => []))};
    const {calls} = this.model;
    if (LIVE.start.length && LIVE.start.every((f) => f.signal || f.begins)) {
      LIVE.start.forEach((field, i) => {
        if (field.begins) this.begin(this.model.starts[i], field, this.begins[i]);
        else this.fill(this.model.starts[i], field, 0);
      });
      this.bits |= calls.reset();
    } else calls.init();
    this.sliders.forEach((row) => {
      const off = this.record !== null || (row.feed !== null && row.feed.checked);
      for (const {knob} of row.knobs) knob.disabled = off;
    });
    this.show(false);
  }

  /** The samples of a field around step k, from the record or the sliders. */
  fill(view, field, k) {
    const width = field.last - field.first + 1, record = this.record;
    for (let e = 0; e < field.elements.length; e++) {
      for (let w = 0; w < width; w++) view[e * width + w] = this.sample(field, e, k + field.first + w, record);
    }
  }

  sample(field, e, k, record) {
    const i = LIVE.inputs.findIndex((f) => f.name === field.name), row = this.sliders[i];
    if (row && row.feed && row.feed.checked) {
      const fed = this.fed.get(`${i} ${e} ${k}`);
      if (fed !== undefined) return fed;
    }
    if (!record) return row ? row.values[e] : field.initial;
    const found = signal_of(record, field.names[e]);
    return found ? found.values[clamp(k - found.at, 0, found.values.length - 1)] : 0;
  }

  steps(count) {
    const {model} = this, record = this.record;
    const end = record ? record.steps : Infinity;
    for (let n = 0; n < count && this.at < end; n++) {
      LIVE.inputs.forEach((field, i) => this.fill(model.inputs[i], field, this.at));
      this.bits |= model.calls.step();
      LIVE.inputs.forEach((field, i) => field.elements.forEach((_, e) => {
        this.series.inputs[i][e].push(this.sample(field, e, this.at, record));
        const width = field.last - field.first + 1;
        if (field.fed_by !== null && field.elements.length * width === model.inputs[i].length) {
          this.fed.set(`${i} ${e} ${this.at + LIVE.outputs[field.fed_by].ahead}`, model.outputs[field.fed_by][e]);
          this.fed.delete(`${i} ${e} ${this.at - 4 - width}`);
        }
      }));
      LIVE.outputs.forEach((field, i) => field.elements.forEach((_, e) => this.series.outputs[i][e].push(model.outputs[i][e])));
      this.at++;
    }
    if (this.at >= end) this.stop();
  }

  toggle() {
    if (this.playing) { this.stop(); return; }
    if (this.record && this.at >= this.record.steps) this.restart();
    this.playing = true;
    this.button.textContent = 'Pause';
    this.last = performance.now();
    this.owed = 0;
    const frame = (now) => {
      if (!this.playing) return;
      const seconds = Math.min(now - this.last, 100) / 1000;
      this.last = now;
      this.owed += seconds * this.rate();
      const whole = Math.floor(this.owed);
      this.owed -= whole;
      if (whole) { this.steps(Math.min(whole, 20000)); this.show(); }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  /** Steps a second: as fast as the plant, or a record in ten seconds. */
  rate() {
    const real = LIVE.sample_time ? 1 / LIVE.sample_time : 50;
    const chosen = this.speed.value;
    if (chosen === 'fit') return this.record ? Math.max(this.record.steps / 10, 5) : Math.max(real, 25);
    return real * Number(chosen);
  }

  stop() { this.playing = false; this.button.textContent = 'Run'; }

  show(keeps = true) {
    const record = this.record, count = this.at, window = record ? count : Math.min(count, 2000);
    const first = count - window, step = LIVE.sample_time || 1;
    const x = {start: first * step, step};
    const cut = (values) => Float64Array.from(values.slice(first));
    const panels = [];
    LIVE.outputs.slice(0, 6).forEach((field, i) => {
      const series = field.elements.slice(0, 6).map((label, e) => ({name: label ? `${field.name}${label}` : field.name, color: i + e === 0 && field.elements.length === 1 ? 'simulated' : COLORS[(i + e) % COLORS.length], wide: true, y: cut(this.series.outputs[i][e]), x}));
      if (record && field.predicts) {
        const found = signal_of(record, field.predicts);
        if (found) series.unshift({name: `${field.predicts} measured`, color: 'measured', thick: true, y: found.values.slice(Math.max(field.ahead - found.at, 0), Math.max(field.ahead - found.at, 0) + record.steps), x: {start: 0, step}});
      }
      panels.push({label: with_unit(field.name, field.unit), height: 180, series});
    });
    LIVE.inputs.slice(0, 6).forEach((field, i) => {
      const series = field.elements.slice(0, 4).map((label, e) => ({name: label ? `${field.name}${label}` : field.name, color: field.elements.length === 1 ? 'input' : COLORS[e % COLORS.length], unlisted: field.elements.length === 1, held: field.held, y: cut(this.series.inputs[i][e]), x}));
      panels.push({label: with_unit(field.name, field.unit), height: 84, series});
    });
    const spec = {label: `Outputs and inputs of ${DATA.name} as it runs, ${count} steps so far`, xlabel: LIVE.sample_time ? 'time / s' : 'step', panels};
    const place = document.getElementById('live-chart');
    if (this.chart) this.chart.show(spec); else this.chart = new Chart(place, spec);
    const names = Object.entries(LIVE.status).filter(([bit]) => this.bits & Number(bit)).map(([, name]) => name);
    this.said.textContent = `${count} ${count === 1 ? 'step' : 'steps'}${names.length ? `; status: ${names.join(', ')}` : ''}`;
  }
}

async function live() {
  const said = document.getElementById('golden');
  try {
    const text = atob(LIVE.wasm), bytes = Uint8Array.from(text, (c) => c.charCodeAt(0));
    const {instance} = await WebAssembly.instantiate(bytes, {});
    const model = new LiveModel(instance);
    const found = model.golden();
    const fine = found.same === found.all && found.agrees;
    said.textContent = LIVE.exact
      ? `${found.same} of ${found.all} golden steps give the bits of the interpreter, as the same C does on a controller.`
      : `${found.agrees ? 'All' : 'Not all'} ${found.all} golden steps agree with the interpreter within rounding, ${found.same} of them to the bit.`;
    said.className = (LIVE.exact ? fine : found.agrees) ? 'verdict good' : 'verdict bad';
    document.getElementById('bench').hidden = false;
    bench = new Bench(model);
  } catch (error) {
    said.textContent = `The model does not run here: ${error.message}`;
    said.className = 'verdict bad';
  }
}

if (LIVE) live();
