'use strict';
// Draws what the companion sends over its WebSocket. Nothing is loaded from elsewhere, and what comes is
// written as text, never as markup.

const $ = id => document.getElementById(id);
const state = { frame: null, slow: null, cuts: null, hello: null, trail: [], at: 0, rate: 0, rtt: null };
const TRAIL_POINTS = 600, EVENTS = 200;
// No message for so long: what is shown is old, ms.
const STALE_MS = 1500;
// A dilution from which on the ramp stays at its end, and one up to which it is good.
const WORST = 5, SOUND = 3;
// Thrown away a second, of some 800 that come: a sound flight has none. Up to here good, and bad beyond.
const FEW_HZ = 20, MANY_HZ = 200;

const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const colours = () => Object.fromEntries(
  ['bg', 'ink', 'soft', 'rule', 'good', 'bad', 'warn', 'est', 'sp', 'd0', 'd1', 'd2', 'd3'].map(n => [n, css('--' + n)]));
let C = colours();
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { C = colours(); heat.clear(); draw(); });

const fixed = (v, n, unit = '') => v === null || v === undefined || !isFinite(v) ? '–' : v.toFixed(n) + unit;

// ---------------------------------------------------------------- connection

let token = sessionStorage.getItem('haltere-token') || '';
if (location.hash.startsWith('#token=')) {
  token = decodeURIComponent(location.hash.slice(7));
  sessionStorage.setItem('haltere-token', token);
  // It should not stay in the address, which people show to others.
  history.replaceState(null, '', location.pathname);
}
let socket = null, opened = false, wait = 500;

function connect() {
  const query = token ? '?token=' + encodeURIComponent(token) : '';
  socket = new WebSocket((location.protocol === 'https:' ? 'wss://' : 'ws://') + location.host + '/live' + query);
  opened = false;
  socket.onopen = () => { opened = true; wait = 500; $('ask').hidden = true; };
  socket.onmessage = message => {
    if (message.data[0] === 'p') { state.rtt = performance.now() - Number(message.data.slice(1)); return; }
    const told = JSON.parse(message.data);
    state.at = performance.now();
    take[told.k]?.(told);
  };
  socket.onclose = () => {
    // A browser does not say why it was turned away; a wrong token is the likeliest where we are not at home.
    const home = ['localhost', '127.0.0.1', '[::1]'].includes(location.hostname);
    if (!opened && (token || !home)) $('ask').hidden = false;
    setTimeout(connect, wait);
    wait = Math.min(wait * 1.6, 5000);
  };
}
$('ask').addEventListener('submit', event => {
  event.preventDefault();
  token = $('token').value.trim();
  sessionStorage.setItem('haltere-token', token);
  socket?.close();
  wait = 100;
});
setInterval(() => { if (socket?.readyState === 1) socket.send('p' + performance.now().toFixed(1)); }, 1000);

// ---------------------------------------------------------------- what comes

let frames = 0;
setInterval(() => { state.rate = frames; frames = 0; }, 1000);
let wanted = false;
function draw() {
  if (wanted) return;
  wanted = true;
  requestAnimationFrame(() => { wanted = false; drawMaps(); });
}

const take = {
  hello(told) {
    state.hello = told;
    state.trail = told.trail;
    state.cuts = told.cuts;
    heat.clear();
    $('events').replaceChildren();
    told.events.forEach(event);
    document.title = 'haltere ' + told.version;
    $('foot').textContent = 'haltere ' + told.version + ' · looks only, commands nothing';
    draw();
  },
  f(told) {
    frames += 1;
    state.frame = told;
    if (told.p) {
      const last = state.trailAt;
      if (last === undefined || told.t - last >= 0.1 || told.t < last) {
        state.trailAt = told.t;
        state.trail.push(told.p);
        if (state.trail.length > TRAIL_POINTS) state.trail.shift();
      }
    }
    head(told);
    draw();
  },
  s(told) { state.slow = told; tables(); },
  d(told) { state.cuts = told.cuts; heat.clear(); draw(); },
  e(told) { told.events.forEach(event); },
};

function chip(id, text, kind) {
  const at = $(id);
  at.textContent = text;
  at.className = 'chip ' + kind;
}

function head(f) {
  $('mode').textContent = f.mode ?? 'disarmed';
  chip('armed', f.armed ? 'armed' : 'disarmed', f.armed ? 'armed' : '');
  const kind = { good: 'good', degraded: 'warn', lost: 'bad' }[f.health] ?? '';
  chip('health', 'estimate ' + f.health, kind);
}

function rows(id, list) {
  $(id).replaceChildren(...list.map(([name, value, kind]) => {
    const row = document.createElement('tr');
    const label = document.createElement('th'), cell = document.createElement('td');
    label.textContent = name;
    cell.textContent = value;
    cell.className = 'n ' + (kind ?? '');
    row.append(label, cell);
    return row;
  }));
}

/** A number with the word for it and its colour: good up to `few`, bad beyond `many`. */
function judged(v, text, few, many) {
  if (v === null || v === undefined) return [text, ''];
  const kind = v > many ? 'bad' : v > few ? 'warn' : 'good';
  return [text + ' · ' + { good: 'good', warn: 'look', bad: 'bad' }[kind], kind];
}

const axes = ['north', 'east', 'height'];
function position() {
  const f = state.frame;
  if (!f) return;
  const list = axes.map((name, i) => {
    const sigma = f.std ? ' ± ' + fixed(f.std[i], 2) : '';
    const goal = f.sp && f.sp[i] !== null ? ' → ' + fixed(f.sp[i], 2) : '';
    return [name, f.p ? fixed(f.p[i], 2) + sigma + goal + ' m' : '–'];
  });
  list.push(['speed', f.v ? fixed(Math.hypot(...f.v), 2, ' m/s') : '–']);
  list.push(['roll, pitch, yaw', f.att ? f.att.map(a => fixed(a, 0)).join('°, ') + '°' : '–']);
  list.push(['dilution here', ...judged(f.dop, fixed(f.dop, 2), SOUND, WORST)]);
  rows('pos', list);
}

function tables() {
  const s = state.slow, f = state.frame, h = state.hello;
  if (!s || !h) return;
  const [done, of] = s.mission ?? [0, 0];
  $('mission').hidden = !of;
  $('mission').textContent = 'mission ' + done + ' of ' + of + ' items';
  $('mission').style.setProperty('--done', 100 * done / of + '%');
  const b = s.battery;
  if (b) {
    const kind = b.v < h.battery.critical ? 'bad' : b.v < h.battery.low ? 'warn' : 'good';
    const left = b.left === null ? '' : ' · ' + Math.round(b.left * 100) + ' %';
    chip('batt', fixed(b.v, 2, ' V') + left, b.age > 2 ? 'bad' : kind);
  } else chip('batt', 'no battery data', '');
  rows('power', [
    ['voltage', b ? fixed(b.v, 2, ' V') : '–', b && b.v < h.battery.low ? 'warn' : ''],
    ['warns, lands below', fixed(h.battery.low, 1) + ', ' + fixed(h.battery.critical, 1, ' V')],
    ['current', b ? fixed(b.a, 2, ' A') : '–'],
    ['charge left', b && b.left !== null ? fixed(b.left * 100, 0, ' %') : '–'],
    ...(s.others ?? []).map(o => ['battery ' + o.id + ', not flown on', fixed(o.v, 2, ' V')]),
    ...(s.servos ? [['motors and servos', s.servos.map(v => v === null ? '–' : fixed(v, 0)).join(', ')]] : []),
    ['thrust', f && f.thrust !== undefined ? fixed(f.thrust * 100, 0, ' %') : '–'],
    ['a limit is touched', f && f.cut ? 'yes' : 'no', f && f.cut ? 'warn' : ''],
  ]);
  const ms = v => v === null || v === undefined ? '–' : fixed(v * 1e3, v < 0.0995 ? 1 : 0, ' ms');
  const d = s.uwb_delay, x = s.health ?? {};
  rows('late', [
    ['ranging, mean', d ? ms(d.mean) : 'none', d ? (d.mean > 0.1 ? 'warn' : '') : 'bad'],
    ['ranging, worst', d ? ms(d.worst) : '–', d && d.worst > 0.3 ? 'bad' : ''],
    ['IMU, age', ms(x.imu_age), x.imu_age > 0.1 ? 'bad' : ''],
    ['control woken late', s.late.of ? s.late.n + ' of ' + s.late.of : '–', s.late.n > 0 ? 'warn' : ''],
    ['worst of them', s.late.of ? ms(s.late.worst) : '–', s.late.worst > 0.005 ? 'warn' : ''],
    ['thrown away now', ...judged(s.thrown_hz, fixed(s.thrown_hz, 0, '/s'), FEW_HZ, MANY_HZ)],
    ['since the start', String(x.drops ?? '–')],
    ['this page', state.rate + '/s, ' + (state.rtt === null ? '–' : fixed(state.rtt, 0, ' ms')) + (s.lost ? ', lost ' + s.lost : '')],
  ]);
  const heard = anchorsOf(s);
  $('anchors').tBodies[0].replaceChildren(...h.anchors.map(({ id }) => {
    const a = heard.get(id), row = document.createElement('tr');
    const cell = (text, kind) => {
      const td = document.createElement('td');
      td.textContent = text;
      td.className = kind ?? '';
      row.append(td);
      return td;
    };
    cell(id);
    cell(a ? fixed(a.hz, 0) : '0', 'n');
    const used = cell('');
    if (a?.out) {
      used.textContent = 'left out';
      used.title = 'does not fit the other anchors: it moved, or something stands before it';
      used.className = 'bad';
    } else if (a) {
      const bar = document.createElement('span'), part = document.createElement('i');
      bar.className = 'bar ' + quality(a);
      part.style.width = Math.round(a.used * 100) + '%';
      bar.title = Math.round(a.used * 100) + ' % of its measurements are used';
      bar.append(part);
      used.append(bar);
    } else { used.textContent = 'not heard'; row.className = 'gone'; }
    cell(a ? fixed(a.rms_m * 100, 0, ' cm') : '–', 'n');
    cell(a ? fixed(a.ratio, 2) : '–', 'n');
    return row;
  }));
}

/** What the last seconds say of each anchor, by its number; those that the filter leaves out say so. */
function anchorsOf(slow) {
  const anchors = new Map((slow?.anchors ?? []).map(a => [a.id, a]));
  for (const id of slow?.health?.left_out ?? []) if (anchors.has(id)) anchors.get(id).out = true;
  return anchors;
}

const quality = a => !a ? 'gone' : a.out ? 'out' : a.used < 0.5 ? 'bad' : a.used < 0.9 || a.ratio > 0.5 ? 'warn' : 'good';

function event({ t, severity, text, mode }) {
  const item = document.createElement('li'), time = document.createElement('time'), words = document.createElement('span');
  time.textContent = fixed(t, 1, ' s');
  words.textContent = text;
  item.className = severity <= 3 ? 'bad' : severity === 4 ? 'warn' : mode ? 'mode' : '';
  item.append(time, words);
  $('events').prepend(item);
  while ($('events').children.length > EVENTS) $('events').lastChild.remove();
}

// ---------------------------------------------------------------- maps

/** A canvas of a given shape, and the way from metres to its pixels; x to the right, y up. */
function sheet(id, [x0, x1], [y0, y1], most) {
  const canvas = $(id), width = canvas.clientWidth;
  const pad = { l: 30, r: 10, t: 8, b: 20 };
  let scale = (width - pad.l - pad.r) / (x1 - x0);
  if ((y1 - y0) * scale > most) scale = most / (y1 - y0);
  const height = Math.round((y1 - y0) * scale + pad.t + pad.b), dpr = devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * dpr) || canvas.height !== Math.round(height * dpr)) {
    canvas.width = Math.round(width * dpr);
    canvas.height = Math.round(height * dpr);
    canvas.style.height = height + 'px';
  }
  const g = canvas.getContext('2d');
  g.setTransform(dpr, 0, 0, dpr, 0, 0);
  g.clearRect(0, 0, width, height);
  const left = pad.l + Math.max(0, (width - pad.l - pad.r - (x1 - x0) * scale) / 2);
  return { g, scale, x: v => left + (v - x0) * scale, y: v => pad.t + (y1 - v) * scale, x0, x1, y0, y1 };
}

const mix = (a, b, s) => a.map((v, i) => Math.round(v + (b[i] - v) * s));
const heat = {
  images: {},
  clear() { this.images = {}; },
  /** The dilution as a small picture, which is then drawn large. */
  image(name, values, n) {
    if (this.images[name]) return this.images[name];
    const stops = ['d0', 'd1', 'd2', 'd3'].map(k => C[k].split(',').map(Number));
    const canvas = document.createElement('canvas');
    canvas.width = canvas.height = n;
    const g = canvas.getContext('2d'), picture = g.createImageData(n, n);
    values.forEach((v, k) => {
      const share = Math.min(Math.max((v - 1) / (WORST - 1), 0), 1) * 3, i = Math.min(Math.floor(share), 2);
      const at = ((n - 1 - Math.floor(k / n)) * n + k % n) * 4;
      picture.data.set([...mix(stops[i], stops[i + 1], share - i), 255], at);
    });
    g.putImageData(picture, 0, 0);
    return this.images[name] = canvas;
  },
};

function ground(s, name, values, n) {
  const { g } = s;
  g.imageSmoothingEnabled = true;
  g.imageSmoothingQuality = 'high';
  // The outer values lie on the edge: the small picture reaches half a cell beyond.
  const cx = (s.x1 - s.x0) / (n - 1) / 2 * s.scale, cy = (s.y1 - s.y0) / (n - 1) / 2 * s.scale;
  const [l, t, w, h] = [s.x(s.x0), s.y(s.y1), (s.x1 - s.x0) * s.scale, (s.y1 - s.y0) * s.scale];
  g.save();
  g.beginPath();
  g.rect(l, t, w, h);
  g.clip();
  g.drawImage(heat.image(name, values, n), l - cx, t - cy, w + 2 * cx, h + 2 * cy);
  g.restore();
  const step = s.scale > 34 ? 1 : s.scale > 17 ? 2 : 5;
  g.strokeStyle = C.rule;
  g.fillStyle = C.soft;
  g.font = '11px system-ui, sans-serif';
  g.lineWidth = 0.7;
  for (let v = Math.ceil(s.x0 / step) * step; v <= s.x1; v += step) {
    line(g, [[s.x(v), t], [s.x(v), t + h]]);
    g.textAlign = 'center';
    g.fillText(v, s.x(v), t + h + 14);
  }
  for (let v = Math.ceil(s.y0 / step) * step; v <= s.y1; v += step) {
    line(g, [[l, s.y(v)], [l + w, s.y(v)]]);
    g.textAlign = 'right';
    g.fillText(v, l - 6, s.y(v) + 4);
  }
}

function line(g, points) {
  g.beginPath();
  points.forEach(([x, y], i) => i ? g.lineTo(x, y) : g.moveTo(x, y));
  g.stroke();
}

/** Everything over the ground; `at` takes north, east, height to right, up. */
function things(s, at, volume) {
  const { g } = s, f = state.frame, px = p => { const [x, y] = at(p); return [s.x(x), s.y(y)]; };
  g.setLineDash([5, 4]);
  g.strokeStyle = C.soft;
  g.lineWidth = 1;
  const [[vx0, vx1], [vy0, vy1]] = volume;
  g.strokeRect(s.x(vx0), s.y(vy1), (vx1 - vx0) * s.scale, (vy1 - vy0) * s.scale);
  g.setLineDash([]);

  g.lineJoin = 'round';
  g.strokeStyle = C.est;
  g.lineWidth = 1.8;
  const trail = state.trail.map(px);
  for (let i = 0; i + 1 < trail.length; i += 15) {
    g.globalAlpha = 0.12 + 0.68 * (i / trail.length);
    line(g, trail.slice(i, i + 16));
  }
  g.globalAlpha = 1;

  const heard = anchorsOf(state.slow), places = new Map();
  for (const { id, p } of state.hello.anchors) {
    const [x, y] = px(p), key = Math.round(x / 12) + ',' + Math.round(y / 12);
    places.set(key, { x, y, ids: [...(places.get(key)?.ids ?? []), id] });
  }
  // Anchors above one another stand side by side, each with its own colour.
  for (const { x, y, ids } of places.values()) {
    ids.forEach((id, i) => {
      const kind = state.slow ? quality(heard.get(id)) : 'gone', at = x + (i - (ids.length - 1) / 2) * 11;
      g.fillStyle = { good: C.good, warn: C.warn, bad: C.bad, out: C.bad, gone: C.soft }[kind];
      g.fillRect(at - 4.5, y - 4.5, 9, 9);
      if (kind === 'out') {
        g.strokeStyle = C.bg;
        g.lineWidth = 2;
        line(g, [[at - 4.5, y - 4.5], [at + 4.5, y + 4.5]]);
        line(g, [[at - 4.5, y + 4.5], [at + 4.5, y - 4.5]]);
      }
      if (kind === 'gone') { g.fillStyle = C.bg; g.fillRect(at - 3, y - 3, 6, 6); }
    });
    const right = x > s.x((s.x0 + s.x1) / 2), away = 4 + 5.5 * ids.length;
    g.fillStyle = C.ink;
    g.font = '600 11.5px system-ui, sans-serif';
    g.textAlign = right ? 'right' : 'left';
    g.fillText(ids.join(', '), x + (right ? -away : away), y + (y < 20 ? 17 : -7));
  }

  if (!f?.p) return null;
  const here = px(f.p), [sx, sy] = at(f.std);
  g.strokeStyle = g.fillStyle = C.est;
  g.globalAlpha = 0.18;
  g.beginPath();
  g.ellipse(...here, Math.max(2 * sx * s.scale, 1), Math.max(2 * sy * s.scale, 1), 0, 0, 7);
  g.fill();
  g.globalAlpha = 1;
  g.lineWidth = 1.5;
  g.stroke();
  return here;
}

/** Over everything else, where the vehicle is asked to be. */
function setpoint(s, at) {
  const f = state.frame;
  if (!f?.sp || !f.p) return;
  const [right, up] = at(f.sp.map((v, i) => v ?? f.p[i])), [x, y, r] = [s.x(right), s.y(up), 13];
  s.g.strokeStyle = C.sp;
  s.g.lineWidth = 1.8;
  line(s.g, [[x - r, y], [x + r, y]]);
  line(s.g, [[x, y - r], [x, y + r]]);
}

function drawMaps() {
  const h = state.hello, c = state.cuts, f = state.frame;
  position();
  if (!h || !c) return;
  const most = Math.max(260, innerHeight * 0.52), east = h.room.e;
  const plan = sheet('plan', east, h.room.n, innerWidth > 820 ? most : 1e9);
  ground(plan, 'plan', c.plan, c.places);
  const here = things(plan, ([n, e]) => [e, n], [h.volume.e, h.volume.n]);
  if (here && f.att) {
    const { g } = plan, yaw = f.att[2] * Math.PI / 180;
    g.save();
    g.translate(...here);
    g.rotate(yaw);
    g.beginPath();
    g.moveTo(0, -14); g.lineTo(9, 10); g.lineTo(0, 5); g.lineTo(-9, 10); g.closePath();
    g.fillStyle = f.health === 'good' ? C.est : f.health === 'degraded' ? C.warn : C.bad;
    g.fill();
    g.restore();
  }
  setpoint(plan, ([n, e]) => [e, n]);
  const side = sheet('side', east, h.room.h, innerWidth > 820 ? Math.max(160, innerHeight * 0.25) : 1e9);
  ground(side, 'side', c.side, c.places);
  const there = things(side, ([, e, up]) => [e, up], [h.volume.e, h.volume.h]);
  const { g } = side;
  g.strokeStyle = C.ink;
  g.lineWidth = 1.5;
  line(g, [[side.x(side.x0), side.y(0)], [side.x(side.x1), side.y(0)]]);
  if (there) { g.fillStyle = C.est; g.beginPath(); g.arc(...there, 4.5, 0, 7); g.fill(); }
  setpoint(side, ([, e, up]) => [e, up]);
  $('plancut').textContent = 'dilution at height ' + fixed(c.height_m, 1, ' m');
  $('sidecut').textContent = 'dilution at north ' + fixed(c.north_m, 1, ' m');
}

addEventListener('resize', draw);
setInterval(() => {
  const age = performance.now() - state.at, old = !state.at || age > STALE_MS;
  document.body.classList.toggle('old', old);
  $('stale').hidden = !old || !state.at;
  if (old && state.at) $('stale').textContent = 'Nothing has come for ' + fixed(age / 1000, 0, ' s') + ': what is shown is old.';
  chip('link', old ? 'not connected' : state.rate + ' frames/s', old ? 'bad' : '');
}, 250);
connect();
