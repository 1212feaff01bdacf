// Joins the streams, the last minute, and what is shown of it.

import { keep, renew } from './connections.js';
import { decode } from './decode.js';
import { Happened } from './happened.js';
import { Health } from './health.js';
import { History } from './history.js';
import { Panel } from './panel.js';
import { Picture } from './picture.js';
import { Space } from './space.js';

const RETRY_MS = 1000;
const QUIET_MS = 3000;
const FORGET_EVERY_MS = 1000;
const CHECK_EVERY_MS = 10000;
/** A camera whose time goes back by more runs anew. */
const BACK_NS = 0.5e9;
/** A server that has not answered by then does not. */
const ANSWERS_WITHIN_MS = 5000;
/** Pages of one server do not all come back in the same moment. */
const SPREAD_MS = 3000;
/** What the server sends after the past. */
const MARK = 'now';
/** How long a frame may be on its way, seconds. */
const ON_THE_WAY_S = 5;
const AWAY = 'not connected: is edgecap view still running? trying again …';
const FULL = 'full: too many pages are open; trying again …';
const BLOCKED = 'the server answers, but no stream comes through: a proxy on the way has to pass WebSockets on, and '
  + 'the page needs a token there; trying again …';
const byId = (id) => document.getElementById(id);
const [say, select, scrub, when, pause] = ['say', 'camera', 'scrub', 'when', 'pause'].map(byId);
const [history, space, panel] = [new History(), openSpace(), new Panel()];
const picture = new Picture(byId('picture'));
const happened = new Happened(byId('events'));
const health = new Health();

/**
 * `at` is the time that is shown, nanoseconds; null: the newest frame. `heard` is when each camera's last frame came,
 * `newest` the latest one of each; `unwritten` says that the tables are those of an earlier frame; `why` says why there
 * is no connection; `isWhole` that all else was asked for, too; `asks` that the server is being asked what
 * it is, and `again` is when it will be; `inVain` is how often in a row no stream came though the server had one;
 * `isPast` says that what comes is of the past; `complete` is the last moment at which nothing was missing, null: there
 * was none.
 */
const state = {
  camera: null, at: null, connected: false, heard: new Map(), newest: new Map(), ended: new Set(), changed: true,
  unwritten: false, isDragged: false, why: 'connecting …', isWhole: false, asks: false, again: 0, inVain: 0,
  isPast: false, complete: null,
};
/** What the server has told of itself; without `server`: nothing yet. */
let features = {};

function openSpace() {
  try {
    return new Space(byId('space'));
  } catch (e) {
    say.textContent = 'this browser has no WebGL: switch graphics acceleration on, or open the page in another one';
    throw e;
  }
}

/** An address of this server, with the token that the page was opened with. */
function url(kind, path, more = {}) {
  const query = new URLSearchParams(location.search);
  for (const [name, value] of Object.entries(more)) query.set(name, value);
  return `${kind}${location.protocol === 'https:' ? 's' : ''}://${location.host}/${path}?${query}`;
}

/** Asks what the server is, until it tells: how much of the past is kept has to be known before it comes. */
async function begin() {
  const answer = await ask();
  if (answer.status === 200) {
    know(answer);
    keep(connect, lost);
  } else {
    state.why = reason(answer);
    setTimeout(begin, RETRY_MS);
  }
}

/** With the past since nothing was missing; of a record all of it. */
function connect() {
  const asked = { format: 'binary', history: '1', mark: '1' };
  if (state.complete && !features.recorded) asked.seconds = Math.ceil(secondsSince(state.complete) + ON_THE_WAY_S);
  const socket = new WebSocket(url('ws', 'bodies', asked));
  socket.binaryType = 'arraybuffer';
  const begun = new Set();
  socket.onopen = () => {
    state.connected = true;
    state.inVain = 0;
    state.isPast = true;
    // Where there is one place left it is for who is in view.
    beside();
    check();
  };
  socket.onmessage = ({ data }) => {
    if (data === MARK) {
      state.isPast = false;
      state.changed = true;
    }
    if (!state.isPast) state.complete = moment();
    const frame = data instanceof ArrayBuffer ? decode(data) : null;
    if (!frame) return;
    if (!frame.ended && !begun.has(frame.camera)) {
      begun.add(frame.camera);
      history.rewind(frame);
    }
    take(frame);
  };
  return socket;
}

function moment() {
  return { steady: performance.now(), wall: Date.now() };
}

/** By the clock that went further: the one may be set, the other stands still while the machine sleeps. */
function secondsSince({ steady, wall }) {
  return Math.max(performance.now() - steady, Date.now() - wall) / 1000;
}

async function lost(opened) {
  state.connected = false;
  state.why = opened ? AWAY : reason(await ask());
}

/** What the server says of itself; `status` 0: nothing, `line`: why it does not. */
async function ask() {
  try {
    const answer = await fetch(url('http', 'features'), { signal: AbortSignal.timeout(ANSWERS_WITHIN_MS) });
    const { status } = answer;
    return status === 200 ? { status, ...await answer.json() } : { status, line: await answer.text() };
  } catch {
    return { status: 0 };
  }
}

/** Why a server that answers so lets this page have no stream. */
function reason({ status, line, loading, full }) {
  const isReady = status === 200 && !loading && !full;
  state.inVain = isReady ? state.inVain + 1 : 0;
  if (status === 403) return `not let in: ${line}`;
  if (loading) return 'the record is still read …';
  if (full || status === 503) return FULL;
  if (!isReady) return AWAY;
  // It may have become ready after it was asked for the stream.
  return state.inVain > 1 ? BLOCKED : state.why;
}

/** Another server may show something else, by another page. */
function reloadIfAnother({ server }) {
  const anew = window.loadAnew ?? (() => location.reload());
  if (server !== features.server) anew(SPREAD_MS * Math.random());
}

function know(told) {
  features = told;
  if (features.seconds) history.keepNs = features.seconds * 1e9;
  if (features.recorded) happened.most = Infinity;
}

/** Pictures, events and how cameras are doing, once. */
function beside() {
  if (state.isWhole) return;
  state.isWhole = true;
  if (features.pictures) picture.connect(url);
  happened.connect(url);
  if (!features.recorded) health.connect(url);
}

/** Whether the server is there, and the same: one that vanished without a word has ended no connection. */
async function check() {
  if (!state.connected || state.asks) return;
  state.asks = true;
  const answer = await ask();
  state.asks = false;
  if (answer.status === 200) reloadIfAnother(answer);
  else if (answer.status === 0) renew();
  else {
    clearTimeout(state.again);
    state.again = setTimeout(check, RETRY_MS);
  }
}

/** Where frames come the server is there. */
function checkSilence() {
  if (performance.now() - Math.max(0, ...state.heard.values()) > QUIET_MS) check();
}

function take(frame) {
  state.heard.set(frame.camera, performance.now());
  noteRun(frame);
  if (frame.ended) {
    state.ended.add(frame.camera);
    showPicture();
    return;
  }
  if (state.ended.delete(frame.camera)) {
    frame.begins = true;
    showPicture();
  }
  history.add(frame);
  if (![...select.options].some((o) => o.value === frame.camera)) {
    select.append(new Option(frame.camera));
    if (state.camera === null || isChosen(frame.camera)) showCamera(frame.camera);
  }
  if (frame.camera === state.camera) state.changed = true;
}

/** Tells where a run begins after another one; frames of the past, which come again, begin none. */
function noteRun(frame) {
  const before = state.newest.get(frame.camera);
  if (before && frame.publishNs < before.publishNs) return;
  if (before && (before.ended || frame.poseNs < before.poseNs - BACK_NS)) happened.begin(frame);
  state.newest.set(frame.camera, frame);
}

/** Whether the user chose this camera, here or on the page that was here before: it stands in the address. */
function isChosen(camera) {
  return location.hash === `#${encodeURIComponent(camera)}`;
}

/** Shows a camera, and again when the page is loaded anew, as soon as it comes. */
function choose(camera) {
  location.replace(`#${encodeURIComponent(camera)}`);
  showCamera(camera);
}

function showCamera(camera) {
  state.camera = camera;
  select.value = camera;
  space.clear();
  panel.clear();
  happened.clear();
  seek(null);
}

/** Shows what was published at a time; null: the newest frame from now on. */
function seek(publishNs) {
  state.at = publishNs;
  state.changed = true;
  history.hold(publishNs === null ? null : history.frames(state.camera)[shownIndex()] ?? null);
  showPicture();
  pause.textContent = publishNs === null ? 'pause' : newestIs();
}

/** Of the camera that is shown, for as long as it runs. */
function showPicture() {
  picture.choose(state.camera, state.at === null && !state.ended.has(state.camera));
}

/** Lets go of cameras of whose past nothing is left. */
function forget() {
  for (const [camera, heard] of state.heard) {
    if (camera === state.camera || performance.now() - heard <= history.keepNs / 1e6) continue;
    const all = [state.heard, state.newest, state.ended, history.cameras, happened.byCamera, health.byCamera];
    for (const kept of all) kept.delete(camera);
    [...select.options].find((o) => o.value === camera)?.remove();
  }
}

/** What the newest frame is called. */
function newestIs() {
  return features.recorded ? 'end' : 'live';
}

function newest() {
  return history.frames(state.camera).at(-1);
}

function shownIndex() {
  const frames = history.frames(state.camera);
  return state.at === null ? frames.length - 1 : history.indexAt(state.camera, state.at);
}

function words() {
  const patience = Math.max(QUIET_MS, 2 * history.interval(state.camera) / 1e6);
  const quiet = performance.now() - (state.heard.get(state.camera) ?? 0) > patience;
  if (!state.connected) return state.why;
  if (state.camera === null) return health.any() ?? 'nobody publishes yet: start edgecap';
  if (features.recorded) return `${state.camera}: recorded`;
  if (state.isPast && state.at === null) return `${state.camera}: the last minute is loading …`;
  if (state.ended.has(state.camera)) return `${state.camera}: the input has ended`;
  if (state.at !== null) return `${state.camera}: paused`;
  return `${state.camera}: ${quiet ? health.why(state.camera) ?? 'no frames come' : 'live'}`;
}

function show(frames, index) {
  state.changed = false;
  const frame = frames[index];
  space.show(frame, frames, index);
  happened.show(frame);
  const ago = (frame.publishNs - newest().publishNs) / 1e9;
  scrub.min = Math.min(-1, (frames[0].publishNs - newest().publishNs) / 1e9);
  if (!state.isDragged || state.at === null) scrub.value = ago;
  when.textContent = state.at === null ? newestIs() : `${ago.toFixed(2)} s`;
  if (state.at === null && state.isPast) when.textContent = '…';
}

function step(now) {
  requestAnimationFrame(step);
  const since = performance.now();
  const frames = history.frames(state.camera);
  const changed = state.changed || happened.changed;
  if ((changed || state.unwritten) && frames.length > 0) {
    const index = shownIndex();
    if (changed) show(frames, index);
    state.unwritten = !panel.show(frames[index], frames, index, now);
  }
  const text = words();
  if (say.textContent !== text) say.textContent = text;
  space.draw(since);
}

function stepFrames(count) {
  const frames = history.frames(state.camera);
  if (frames.length === 0) return;
  const index = Math.min(frames.length - 1, Math.max(0, shownIndex() + count));
  seek(frames[index].publishNs);
}

select.onchange = () => choose(select.value);
pause.onclick = () => seek(state.at === null ? (newest()?.publishNs ?? null) : null);
scrub.oninput = () => {
  const seconds = scrub.valueAsNumber;
  seek(seconds >= 0 || !newest() ? null : newest().publishNs + seconds * 1e9);
};
scrub.addEventListener('pointerdown', () => { state.isDragged = true; });
for (const over of ['pointerup', 'pointercancel']) window.addEventListener(over, () => { state.isDragged = false; });
window.addEventListener('keydown', (e) => {
  // The browser's own, and those that choose among cameras.
  if (e.altKey || e.ctrlKey || e.metaKey || e.target === select) return;
  if (e.code === 'Space') pause.onclick();
  else if (e.code === 'ArrowLeft') stepFrames(-1);
  else if (e.code === 'ArrowRight') stepFrames(1);
  else return;
  e.preventDefault();
});

// For whoever drives the page by a program.
window.edgecap = {
  scene: () => ({ ...space.read(), state: say.textContent, frames: history.frames(state.camera).length }),
  picture: () => picture.read(),
  events: () => happened.until(history.frames(state.camera)[shownIndex()]),
  frames: () => history.frames(state.camera).map((f) => f.sequence),
  choose,
  seek: (seconds) => seek(seconds >= 0 ? null : newest().publishNs + seconds * 1e9),
};

begin();
window.addEventListener('online', check);
document.addEventListener('visibilitychange', () => { if (!document.hidden) check(); });
setInterval(checkSilence, CHECK_EVERY_MS);
setInterval(forget, FORGET_EVERY_MS);
requestAnimationFrame(step);
