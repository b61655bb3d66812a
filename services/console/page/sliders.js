// Where a slider's ends are, and what each place on it means; a value beyond its ends is typed beside it.

const STEPS = 1000;
const DECADES = 1e4;  // below its highest value where a logarithmic slider ends that could go on to 0

// {low, high} of a field's slider, or null for a field that has no range for one.
export function reach(field) {
  const [low, high] = field.slider ?? [field.low, field.high];
  if (low === null || high === null) return null;
  return { low: field.log ? Math.max(low, high / DECADES) : low, high };
}

// A place from 0 to STEPS as a value. The left end of a logarithmic slider is 0 where that is allowed.
export function valueAt(field, place) {
  const { low, high } = reach(field);
  if (!field.log) return rounded(field, Math.min(high, low + ((high - low) * place) / STEPS));
  if (place <= 0 && field.low === 0 && !field.low_open) return 0;
  return rounded(field, low * (high / low) ** (place / STEPS));
}

export function placeOf(field, value) {
  const { low, high } = reach(field);
  const share = field.log ? (value <= low ? 0 : Math.log(value / low) / Math.log(high / low)) : (value - low) / (high - low);
  return Math.round(STEPS * Math.min(Math.max(share, 0), 1));
}

// How far one press of an arrow key goes: a step of the field where that is coarser than a place.
export function stride(field) {
  const ends = reach(field);
  return field.log || !field.step ? 5 : Math.max(1, (STEPS * field.step) / (ends.high - ends.low));
}

export const LAST = STEPS;

function rounded(field, value) {
  if (field.kind === "int") return Math.round(value);
  if (field.log || !field.step) return Number(value.toPrecision(2));
  return Number((field.low + Math.round((value - field.low) / field.step) * field.step).toPrecision(6));
}
