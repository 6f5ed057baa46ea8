// Keys that the page has a meaning for do nothing else, and a button that was clicked does not keep them.
document.addEventListener('click', (event) => {
  const button = event.detail > 0 && event.target.closest?.('button');
  if (button && !button.closest('.q-dialog')) setTimeout(() => button.blur());
}, true);
document.addEventListener('keydown', (event) => {
  const saves = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === 's';
  const field = event.target.closest?.('input, textarea, select');
  if (saves) event.preventDefault();
  if (field && !field.closest('.q-dialog') && (saves || event.key === 'Escape')) {
    // What was typed counts, and the key is the page's.
    field.blur();
  } else if (event.target === document.body && (event.key === ' ' || event.key.startsWith('Arrow'))) {
    event.preventDefault();
  }
}, true);
