// Keys that the page has a meaning for do nothing else, and a button that was clicked does not keep them.
document.addEventListener('click', (event) => {
  if (!event.detail || !event.target.closest?.('button')) return;
  // The button hands the focus to a part of itself a moment after the click.
  for (const wait of [0, 60]) {
    setTimeout(() => {
      const active = document.activeElement;
      if (active?.closest('button') && !active.closest('.q-dialog')) active.blur();
    }, wait);
  }
}, true);
document.addEventListener('keydown', (event) => {
  const saves = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === 's';
  const field = event.target.closest?.('input, textarea, select');
  if (saves) event.preventDefault();
  if (field && !field.closest('.q-dialog') && (saves || event.key === 'Escape')) {
    // What was typed counts, and the key is the page's.
    field.blur();
  } else if (event.target.matches('body, .q-layout') && (event.key === ' ' || event.key.startsWith('Arrow'))) {
    event.preventDefault();
  }
}, true);
