// The time of a replay: it runs, stands or jumps, within the longest of the episodes that it shows.

export const SPEEDS = [0.1, 0.25, 0.5, 1, 2];

export class Clock {
  // `duration` and `period`, of a frame, in s.
  constructor(duration, period) {
    this.duration = duration;
    this.period = period;
    this.time = 0;
    this.speed = 1;
    this.running = false;
    this.loop = false;
  }

  get ended() {
    return this.time >= this.duration;
  }

  // From the start again, if it stands at the end.
  play() {
    if (this.ended) this.time = 0;
    this.running = this.duration > 0;
  }

  pause() {
    this.running = false;
  }

  seek(time) {
    if (Number.isFinite(time)) this.time = Math.min(Math.max(time, 0), this.duration);
  }

  // To the next frame, or by so many, of which none is left out.
  step(frames) {
    this.running = false;
    const at = this.time / this.period;
    const near = Math.round(at);
    const here = Math.abs(at - near) < 1e-6 ? near : frames > 0 ? Math.floor(at) : Math.ceil(at);
    // The last frame is the end, and may be less than a period after the one before it.
    this.seek(frames < 0 && this.ended ? (Math.ceil(at - 1e-6) + frames) * this.period
      : (here + frames) * this.period);
  }

  faster(by) {
    const place = SPEEDS.indexOf(this.speed) + by;
    if (place >= 0 && place < SPEEDS.length) this.speed = SPEEDS[place];
  }

  // Lets so many seconds of the reader's time pass. A tab that was hidden does not jump ahead.
  pass(seconds) {
    if (!this.running) return;
    this.seek(this.time + Math.min(Math.max(seconds, 0), 0.25) * this.speed);
    if (!this.ended) return;
    if (this.loop) this.time = 0;
    else this.running = false;
  }
}
