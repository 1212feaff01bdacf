// A page that lacks one of its files shows nothing: it is loaded again. The server may have had no place for the file.

{
  let waits = false;
  const look = async () => {
    const signal = AbortSignal.timeout(5000);
    const answer = await fetch(location.href, { cache: 'no-store', signal }).catch(() => null);
    // Without a server a browser would go to a page of its own, and stay there.
    if (answer?.ok) location.reload();
    else setTimeout(look, 1000);
  };
  /** Loads the page again after so long, as soon as the server has it. */
  window.loadAnew = (afterMs) => {
    if (!waits) setTimeout(look, afterMs);
    waits = true;
  };
}

window.addEventListener('error', ({ target }) => {
  if (target.matches?.('script, [rel=stylesheet]')) window.loadAnew(3000 + 3000 * Math.random());
}, true);
