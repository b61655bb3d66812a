// A small histogram of latencies, with the median and the 95th percentile marked.
import { colours } from "./trace_plot.js";

const FOOT_PX = 16;

export function histogram(canvas, latency) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width) return;  // its panel is not in sight
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d"), colour = colours(canvas);
  context.scale(ratio, ratio);
  if (latency === null || !latency.counts.length) return;
  const bins = latency.counts.length, wide = width / bins;
  const most = Math.max(...latency.counts, 1);
  context.fillStyle = colour("bar");
  latency.counts.forEach((count, at) => {
    const high = (count / most) * (height - FOOT_PX - 4);
    context.fillRect(at * wide + 0.5, height - FOOT_PX - high, Math.max(wide - 1, 1), high);
  });
  context.fillStyle = colour("soft");
  context.fillRect(0, height - FOOT_PX, width, 1);
  context.font = "11px system-ui, sans-serif";
  context.fillText("0", 0, height - 3);
  const end = `${Math.round(latency.bin_ms * (bins - 1))} ms and more`;
  context.fillText(end, width - context.measureText(end).width, height - 3);
  for (const [name, ms] of [["median", latency.p50_ms], ["95 %", latency.p95_ms]]) {
    const x = Math.min(ms / latency.bin_ms, bins) * wide;
    context.fillStyle = colour("text");
    context.fillRect(x, 0, 1.5, height - FOOT_PX);
    const text = `${name} ${ms.toFixed(0)}`;
    const left = x + 4 + context.measureText(text).width < width ? x + 4 : x - 4 - context.measureText(text).width;
    context.fillText(text, left, name === "median" ? 10 : 24);
  }
}
