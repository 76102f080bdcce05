// The charts of a report: phases as bands, what is free air veiled, touches marked, one zoom and one cursor for all.
(() => {
  "use strict";
  const holder = document.getElementById("report-data");
  if (!holder) return;
  const data = JSON.parse(holder.textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const ink = () => css("--ink");
  const quiet = () => css("--quiet");
  const colour = name => (name.startsWith("#") ? name : css("--" + name));
  const charts = [];
  const seconds = steps => { let sum = 0; return steps.map(step => (sum += step) * data.tick); };
  const scaled = (column, step) => column.map(value => value === null ? null : value * step);
  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
  let shown = [data.start, data.end];

  // two recordings: each is moved so that the chosen phase begins at 0
  const shifts = data.aligned ? data.aligned.map(() => 0) : [];
  const joined = spec => uPlot.join(spec.parts.map((part, index) =>
    [seconds(part.t).map(time => time - shifts[index]), ...part.y.map(column => scaled(column, spec.step))]));
  const columns = (spec, index) => {
    if (spec.parts) return joined(spec);
    const set = spec.sets[index];
    return [seconds(set.t), ...set.y.map(column => scaled(column, spec.step))];
  };

  const phaseAt = time => {
    const found = data.phases.find(phase => time >= phase.start && time < phase.end);
    return found ? found.name : "";
  };
  const isFree = time => data.free.some(([start, end]) => time >= start && time <= end);

  function bands(u, spec) {
    const { ctx, bbox } = u, left = bbox.left, right = bbox.left + bbox.width;
    ctx.save();
    for (const phase of data.phases) {
      const from = clamp(u.valToPos(phase.start, "x", true), left, right);
      const to = clamp(u.valToPos(phase.end, "x", true), left, right);
      if (to <= from) continue;
      ctx.globalAlpha = 0.12;
      ctx.fillStyle = phase.colour;
      ctx.fillRect(from, bbox.top, to - from, bbox.height);
      if (!spec.strip) continue;
      const high = 18 * devicePixelRatio;
      ctx.globalAlpha = 1;
      ctx.fillRect(from, bbox.top - high, Math.max(to - from, devicePixelRatio), high);
      ctx.font = 11 * devicePixelRatio + "px system-ui, sans-serif";
      if (ctx.measureText(phase.name).width + 6 * devicePixelRatio < to - from) {
        ctx.fillStyle = "#101216";
        ctx.textAlign = "center";
        ctx.textBaseline = "middle";
        ctx.fillText(phase.name, (from + to) / 2, bbox.top - high / 2);
      }
    }
    ctx.restore();
  }

  function marks(u, spec) {
    const { ctx, bbox } = u, left = bbox.left, right = bbox.left + bbox.width, ratio = devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    if (spec.free) {
      let widest = null;
      for (const [start, end] of data.free) {
        const from = clamp(u.valToPos(start, "x", true), left, right), to = clamp(u.valToPos(end, "x", true), left, right);
        if (to <= from) continue;
        ctx.globalAlpha = 0.62;
        ctx.fillStyle = css("--page");
        ctx.fillRect(from, bbox.top, to - from, bbox.height);
        if (!widest || to - from > widest[1] - widest[0]) widest = [from, to];
      }
      ctx.globalAlpha = 1;
      ctx.font = "italic " + 11.5 * ratio + "px system-ui, sans-serif";
      const said = "free air: the tool's inertia, no contact";
      const text = widest && ctx.measureText(said).width + 12 * ratio < widest[1] - widest[0] ? said : "free air";
      if (widest && ctx.measureText(text).width + 8 * ratio < widest[1] - widest[0]) {
        ctx.fillStyle = quiet();
        ctx.textAlign = "center";
        ctx.fillText(text, (widest[0] + widest[1]) / 2, bbox.top + bbox.height - 8 * ratio);
      }
    }
    ctx.strokeStyle = ctx.fillStyle = css("--bad");
    ctx.setLineDash([6 * ratio, 4 * ratio]);
    if (spec.limits && spec.limits.length) {
      ctx.font = 11.5 * ratio + "px system-ui, sans-serif";
      ctx.textAlign = "right";
      const seen = spec.limits.some(limit => limit > u.scales.y.min && limit < u.scales.y.max);
      if (!seen) ctx.fillText("the limits, ±100 %, are out of sight", left + bbox.width - 6 * ratio, bbox.top + 13 * ratio);
    }
    for (const limit of spec.limits || []) {
      const at = u.valToPos(limit, "y", true);
      ctx.beginPath();
      ctx.moveTo(left, at);
      ctx.lineTo(right, at);
      ctx.stroke();
    }
    ctx.strokeStyle = ink();
    ctx.setLineDash([2 * ratio, 3 * ratio]);
    ctx.font = "600 " + 11 * ratio + "px system-ui, sans-serif";
    ctx.textAlign = "center";
    let free = -Infinity;
    for (const touch of spec.touches ? data.touches : []) {
      const at = u.valToPos(touch.t, "x", true);
      if (at < left || at > right) continue;
      ctx.globalAlpha = 0.55;
      ctx.beginPath();
      ctx.moveTo(at, bbox.top);
      ctx.lineTo(at, bbox.top + bbox.height);
      ctx.stroke();
      ctx.globalAlpha = 1;
      const wide = ctx.measureText(touch.label).width + 6 * ratio;
      const middle = clamp(at, left + wide / 2, right - wide / 2);
      if (middle - wide / 2 < free) continue;
      free = middle + wide / 2;
      ctx.fillStyle = css("--page");
      ctx.fillRect(middle - wide / 2, bbox.top + 2 * ratio, wide, 15 * ratio);
      ctx.fillStyle = ink();
      ctx.fillText(touch.label, middle, bbox.top + 13.5 * ratio);
    }
    ctx.restore();
  }

  let moving = false;
  function show(min, max) {
    if (moving || !(max > min)) return;
    moving = true;
    // a double-click shows all samples: from the first to the last, which is all but the edges
    if (min - data.start < 0.05 && data.end - max < 0.05) [min, max] = [data.start, data.end];
    shown = [min, max];
    for (const { u } of charts) u.setScale("x", { min, max });
    for (const button of document.querySelectorAll("[data-from]")) {
      const here = Math.abs(button.dataset.from - min) < 1e-3 && Math.abs(button.dataset.to - max) < 1e-3;
      button.setAttribute("aria-pressed", String(here));
    }
    moving = false;
  }

  function touchable(u) {
    const over = u.over;
    let began = null;
    const at = touch => touch.clientX - over.getBoundingClientRect().left;
    over.addEventListener("touchstart", event => {
      if (event.touches.length !== 2) return;
      const xs = [at(event.touches[0]), at(event.touches[1])];
      began = { values: xs.map(x => u.posToVal(x, "x")) };
    }, { passive: true });
    over.addEventListener("touchmove", event => {
      if (event.touches.length === 1) {
        u.setCursor({ left: clamp(at(event.touches[0]), 0, over.clientWidth), top: 20 });
        return;
      }
      if (!began || event.touches.length !== 2) return;
      event.preventDefault();
      const [a, b] = [at(event.touches[0]), at(event.touches[1])], [va, vb] = began.values;
      if (Math.abs(a - b) < 12) return;
      const each = (vb - va) / (b - a), min = va - a * each;
      show(clamp(min, data.start, data.end), clamp(min + over.clientWidth * each, data.start, data.end));
    }, { passive: false });
    over.addEventListener("touchend", () => { began = null; });
    over.addEventListener("wheel", event => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      const centre = u.posToVal(event.clientX - over.getBoundingClientRect().left, "x");
      const by = event.deltaY < 0 ? 0.8 : 1.25;
      show(Math.max(data.start, centre - (centre - shown[0]) * by), Math.min(data.end, centre + (shown[1] - centre) * by));
    }, { passive: false });
  }

  function make(element) {
    const spec = data.charts.find(each => each.id === element.dataset.chart);
    if (!spec) return;
    const narrow = () => element.clientWidth < 560;
    const value = (u, v) => v === null || v === undefined ? "–" : v.toFixed(spec.digits).replace("-", "−");
    const timeText = v => {
      if (v === null || v === undefined) return "–";
      const phase = data.aligned ? "" : phaseAt(v);
      return v.toFixed(2).replace("-", "−") + " s" + (phase ? " · " + phase : "") + (spec.free && isFree(v) ? " · free air" : "");
    };
    const axis = { stroke: ink, font: "12px system-ui, sans-serif", grid: { stroke: () => css("--grid"), width: 1 },
      ticks: { stroke: () => css("--grid"), width: 1, size: 4 } };
    const u = new uPlot({
      width: element.clientWidth, height: spec.height,
      padding: [spec.strip ? 24 : 8, 20, 0, 0],
      cursor: { sync: { key: "time", setSeries: false }, drag: { x: true, y: false, dist: 6 }, points: { size: 6 } },
      legend: { live: true },
      scales: { x: { time: false }, y: { range: (self, low, high) => {
        if (low === null || high === null) return [-1, 1];
        const room = 0.06 * (high - low) || 1;
        return [low - room, high + (spec.touches ? 2.6 : spec.limits ? 2 : 1) * room];
      } } },
      axes: [{ ...axis, size: 30 }, { ...axis, size: narrow() ? 44 : 58, label: spec.label, labelSize: 18,
        labelFont: "12px system-ui, sans-serif", values: (self, ticks) => ticks.map(tick => String(+tick.toFixed(6)).replace("-", "−")) }],
      series: [{ label: "t", value: (self, v) => timeText(v) }, ...spec.series.map(line => ({
        label: line.label, stroke: () => colour(line.colour), width: line.width || 1.25, dash: line.dash, value,
        points: { show: false }, spanGaps: Boolean(spec.parts) }))],
      hooks: {
        drawClear: [self => bands(self, spec)],
        draw: [self => marks(self, spec)],
        setScale: [(self, key) => { if (key === "x") show(self.scales.x.min, self.scales.x.max); }],
      },
    }, columns(spec, 0), element);
    const entry = { u, spec, set: 0 };
    charts.push(entry);
    touchable(u);
    new ResizeObserver(() => {
      if (element.clientWidth && element.clientWidth !== u.width) u.setSize({ width: element.clientWidth, height: spec.height });
    }).observe(element);
  }

  const redraw = entry => {
    const [min, max] = shown;
    entry.u.setData(columns(entry.spec, entry.set), false);
    moving = true;
    entry.u.setScale("x", { min, max });
    moving = false;
  };

  document.querySelectorAll("[data-chart]").forEach(make);
  show(data.start, data.end);

  for (const button of document.querySelectorAll("[data-from]")) {
    button.addEventListener("click", () => show(Number(button.dataset.from), Number(button.dataset.to)));
  }
  for (const choice of document.querySelectorAll("input[name=set]")) {
    choice.addEventListener("change", () => {
      for (const entry of charts) {
        if (!entry.spec.sets || entry.spec.sets.length < 2) continue;
        entry.set = Number(choice.value);
        redraw(entry);
      }
    });
  }
  const align = document.getElementById("align");
  if (align) {
    const apply = () => {
      const [start, end] = data.spans[align.value];
      data.aligned.forEach((marks, index) => { shifts[index] = marks[align.value]; });
      [data.start, data.end] = [start, end];
      data.phases = data.bands[align.value];
      shown = [start, end];
      charts.forEach(redraw);
      show(start, end);
    };
    align.addEventListener("change", apply);
    apply();
  }
  dark.addEventListener("change", () => charts.forEach(({ u }) => u.redraw(false, true)));
  document.documentElement.dataset.charts = String(charts.length);
})();
