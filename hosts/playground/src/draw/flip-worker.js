// FLIP beside the page: a large picture takes seconds.

import { flip } from './flip.js';

addEventListener('message', ({ data: { first, second, size } }) => postMessage(flip(first, second, size)));
