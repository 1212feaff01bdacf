// A page that lacks one of its files shows nothing: it is loaded again. The server may have had no place for the file.

window.addEventListener('error', ({ target }) => {
  if (target.matches?.('script, [rel=stylesheet]')) setTimeout(() => location.reload(), 3000 + 3000 * Math.random());
}, true);
