// Fills the page: charts of records, errors, training and learned functions.
'use strict';

const DATA = JSON.parse(document.getElementById('data').textContent);

/** The values of a signal of a record, and the step of the run to which its first one belongs. */
function signal_of(record, name) {
  const found = record.signals[name];
  return found && {values: numbers(found), at: found.at || 0, every: found.every || 1};
}

function spread(record, values, at = 0, every = 1) {
  const x = record.x;
  if (x.step !== undefined) return {start: x.start + at * x.step, step: x.step * every};
  const known = numbers(x);
  if (at === 0 && every === 1) return Float64Array.from(known);
  const step = known.length > 1 ? (known[known.length - 1] - known[0]) / (known.length - 1) : 1;
  return Float64Array.from(values, (_, i) => known[Math.round(i * every) + at] ?? known[0] + (i * every + at) * step);
}

function range_lines(item) {
  const lines = [];
  if (item.low !== null) lines.push({y: item.low, label: 'least of its range', far: true, below: true});
  if (item.high !== null) lines.push({y: item.high, label: 'most of its range', far: true});
  return lines;
}

function with_unit(name, unit) { return unit ? `${name} / ${unit}` : name; }

function record_spec(record) {
  const panels = [];
  for (const output of record.outputs) {
    const every = output.simulated.every || 1;
    const simulated = numbers(output.simulated), x = spread(record, simulated, 0, every);
    const series = [];
    let measured = null;
    if (output.measured) {
      const found = output.measured.signal ? signal_of(record, output.measured.signal) : {values: numbers(output.measured), at: 0, every: output.measured.every || 1};
      const shift = output.measured.signal ? found.at - output.measured.ahead : 0;
      measured = found.values;
      series.push({name: 'measured', label: `${output.name} measured`, color: 'measured', thick: true, y: measured, x: spread(record, measured, shift, found.every)});
      if (output.error) {
        const error = numbers(output.error);
        output.residual = {y: error, x: spread(record, error, 0, output.error.every || 1)};
      } else if (every === 1 && found.every === 1) {
        const residual = new Float32Array(simulated.length);
        for (let i = 0; i < residual.length; i++) residual[i] = simulated[i] - (measured[i - shift] ?? NaN);
        output.residual = {y: residual, x};
      }
    }
    series.push({name: 'simulated', label: `${output.name} simulated`, color: 'simulated', wide: true, y: simulated, x});
    panels.push({label: with_unit(output.name, output.unit), height: 190, series, lines: range_lines(output)});
    if (output.residual) {
      panels.push({label: with_unit('error', output.error_unit), height: 84, zero: true, lines: [{y: 0, solid: true, color: 'muted'}],
        series: [{name: 'error', label: `error of ${output.name}`, color: 'residual', ...output.residual}]});
    }
  }
  for (const input of record.inputs) {
    const found = signal_of(record, input.signal);
    panels.push({label: with_unit(input.signal, input.unit), height: 92, lines: range_lines(input),
      series: [{name: 'input', label: input.signal, color: 'input', held: input.held, y: found.values, x: spread(record, found.values, found.at, found.every)}]});
  }
  return {label: `Measured and simulated outputs, errors and inputs of ${record.name}`, xlabel: record.timed ? 'time / s' : 'row of the file', panels, note: record.note};
}

function score_text(record) {
  return record.outputs.filter((o) => o.rmse !== null).map((o) =>
    `${o.name}: ${o.fit === null ? '' : `fit ${number(o.fit, 4)} %, `}rmse ${number(o.rmse, 4)}${o.error_unit ? ` ${o.error_unit}` : ''}`).join(' · ');
}

function show_records() {
  const place = document.getElementById('record-chart');
  if (!place) return;
  const chooser = document.getElementById('record'), title = document.getElementById('record-score');
  let chart = null;
  const show = () => {
    const record = DATA.records[chooser.selectedIndex];
    title.textContent = score_text(record);
    if (chart) chart.show(record_spec(record)); else chart = new Chart(place, record_spec(record));
  };
  chooser.addEventListener('change', show);
  show();
}

for (const place of document.querySelectorAll('[data-chart]')) new Chart(place, DATA.charts[place.dataset.chart]);
show_records();
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => charts.forEach((c) => c.draw()));
