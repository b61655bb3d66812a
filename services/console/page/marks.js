// Draws over a frame, for each eye: where it looks and how far its lids are closed.

const LIGHT = "#ffffff", DARK = "#000000";
const CROSS_PX = 9, HALF_OPEN = 0.9;
const LIDS_DOWN = ["closing", "blink", "opening"];
const WORDS = { blink: "blink", lost: "eye lost", dropout: "no pupil", closing: "closing", opening: "opening" };

// `place`: where the picture of all eyes lies on the canvas; `shown`: what was rendered in it.
export function drawMarks(context, place, shown, ratio) {
  const width = place.width / shown.eyes.length;
  shown.eyes.forEach((eye, number) => {
    const left = place.left + number * width;
    const scale = width / shown.width_px;
    context.save();
    context.beginPath();
    context.rect(left, place.top, width, place.height);
    context.clip();
    context.lineWidth = ratio;
    cross(context, left + eye.gaze_px[0] * scale, place.top + eye.gaze_px[1] * scale, ratio);
    lids(context, eye, left, place.top, width, place.height);
    context.restore();
    name(context, eye, left, place.top, place.height, ratio, shown.eyes.length > 1);
  });
}

// Every line twice, light on dark: to be seen on any picture.
function twice(context, ratio, path) {
  for (const [ink, wide] of [[DARK, 3], [LIGHT, 1.2]]) {
    context.strokeStyle = ink;
    context.lineWidth = wide * ratio;
    context.beginPath();
    path();
    context.stroke();
  }
}

function cross(context, x, y, ratio) {
  const long = CROSS_PX * ratio, gap = 3 * ratio;
  twice(context, ratio, () => {
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + dx * gap, y + dy * gap);
      context.lineTo(x + dx * long, y + dy * long);
    }
  });
}

function lids(context, eye, left, top, width, height) {
  if (!LIDS_DOWN.includes(eye.phase) && eye.openness > HALF_OPEN) return;
  const closed = 1 - Math.min(Math.max(eye.openness, 0), 1);
  context.fillStyle = "rgb(70 60 55 / 0.45)";
  const upper = height * 0.5 * closed;
  context.fillRect(left, top, width, upper);
  context.fillRect(left, top + height - upper, width, upper);
}

function name(context, eye, left, top, height, ratio, several) {
  const words = [several ? `${eye.eye} eye` : null, WORDS[eye.phase]].filter(Boolean).join(": ");
  if (!words) return;
  context.font = `600 ${13 * ratio}px system-ui, sans-serif`;
  const wide = context.measureText(words).width;
  context.fillStyle = "rgb(0 0 0 / 0.7)";
  context.fillRect(left, top, wide + 12 * ratio, 20 * ratio);
  context.fillStyle = LIGHT;
  context.fillText(words, left + 6 * ratio, top + 14.5 * ratio);
}
