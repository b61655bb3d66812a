// The last seconds of both pupils: samples, what the tracker saw of each, fast movements, and screens shown.

export const SECONDS = 20;
export const EYES = ["right", "left"];
const KEEP_S = SECONDS + 5;

export class TraceStore {
  constructor() { this.clear(); }

  clear() {
    this.t_s = [];
    this.eyes = Object.fromEntries(EYES.map((eye) => [eye, { mm: [], measured_mm: [], phase: [] }]));
    this.saccades = [];  // {t_s, kind, amplitude_deg}
    this.screens = [];  // {t_s, screen}; the newest holds on
  }

  // What there is now, to be held while this goes on.
  copy() {
    const copy = new TraceStore();
    for (const name of ["t_s", "eyes", "saccades", "screens"]) copy[name] = structuredClone(this[name]);
    return copy;
  }

  get newest_s() { return this.t_s.at(-1) ?? null; }

  // A state: {t_s, right: {mm, measured_mm, phase}, left: {…}}. Time that runs backwards begins a new trace.
  add(state) {
    if (this.newest_s !== null && state.t_s < this.newest_s - 1) this.clear();
    this.t_s.push(state.t_s);
    for (const eye of EYES) {
      const kept = this.eyes[eye], one = state[eye];
      kept.mm.push(one.mm ?? NaN);
      kept.measured_mm.push(one.measured_mm ?? NaN);
      kept.phase.push(one.phase);
    }
  }

  addSaccade(saccade) { this.saccades.push(saccade); }

  addScreen(t_s, screen) {
    if (this.screens.at(-1)?.screen !== screen) this.screens.push({ t_s, screen });
  }

  // Lets go of what has scrolled out of sight, now and then and not each time.
  trim(now_s) {
    const old = now_s - KEEP_S;
    if (this.t_s.length && this.t_s[0] < old - KEEP_S) {
      const first = this.firstAfter(old);
      this.t_s.splice(0, first);
      for (const eye of EYES) for (const values of Object.values(this.eyes[eye])) values.splice(0, first);
    }
    this.saccades = this.saccades.filter((saccade) => saccade.t_s > old);
    // The screen before the first one in sight reaches into it.
    while (this.screens.length > 1 && this.screens[1].t_s < old) this.screens.shift();
  }

  // The index of the first sample at or after a time.
  firstAfter(t_s) {
    let low = 0, high = this.t_s.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.t_s[middle] < t_s) low = middle + 1; else high = middle;
    }
    return low;
  }

  // Stretches of one phase between two times: [{phase, from_s, to_s}], without those of tracking.
  *spans(eye, from_s, to_s) {
    const phases = this.eyes[eye].phase;
    let begun = this.firstAfter(from_s);
    for (let at = begun + 1; at <= phases.length; at++) {
      if (at < phases.length && phases[at] === phases[begun]) continue;
      if (phases[begun] !== "tracking") {
        yield { phase: phases[begun], from_s: this.t_s[begun], to_s: at < phases.length ? this.t_s[at] : Math.min(to_s, this.t_s[at - 1]) };
      }
      begun = at;
    }
  }

  // What the axis should hold: whole millimetres around both eyes' trusted diameters, 2 of them at least.
  range_mm(from_s) {
    let low = Infinity, high = -Infinity;
    const first = this.firstAfter(from_s);
    for (const eye of EYES) {
      const mm = this.eyes[eye].mm;
      for (let at = first; at < mm.length; at++) {
        if (mm[at] < low) low = mm[at];
        if (mm[at] > high) high = mm[at];
      }
    }
    if (low > high) return [2, 8];
    [low, high] = [Math.floor(low - 0.25), Math.ceil(high + 0.25)];
    return high - low < 3 ? [Math.max(low - 1, 0), high + 1] : [Math.max(low, 0), high];
  }
}
