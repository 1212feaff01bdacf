// WebSockets that are made again whenever they end.

const RETRY_MS = 1000;
/** One that has not opened by then does not. */
const OPENS_WITHIN_MS = 10000;
const all = new Map();

/** Keeps one: `make` makes it, `ended` hears of every end, and whether it had opened before. */
export function keep(make, ended = () => {}) {
  const socket = make();
  let opened = false;
  const end = () => {
    if (!all.delete(socket)) return;
    socket.onopen = socket.onmessage = null;
    socket.close();
    ended(opened);
    setTimeout(() => keep(make, ended), RETRY_MS);
  };
  all.set(socket, end);
  socket.addEventListener('open', () => { opened = true; });
  socket.addEventListener('close', end);
  setTimeout(() => { if (!opened) end(); }, OPENS_WITHIN_MS);
}

/** Gives them all up: a server that vanished without a word closes none. */
export function renew() {
  for (const end of [...all.values()]) end();
}
