// Elements, and what the page says to a screen reader.

/** An element. Properties that begin with `on` are listeners; `null` and `false` leave an attribute out. */
export function h(name, attributes = {}, ...children) {
    const element = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
        if (value === null || value === undefined || value === false) continue;
        if (key.startsWith('on')) element.addEventListener(key.slice(2), value);
        else element.setAttribute(key, value === true ? '' : value);
    }
    element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
    return element;
}

export const code = (text) => h('code', {}, text);
export const find = (id) => document.getElementById(id);

/** A sentence with its `names` in code. */
export const marked = (text) =>
    h(
        'span',
        {},
        text.split('`').map((part, i) => (i % 2 ? code(part) : part)),
    );

/** A list, or nothing where there is nothing to list. */
export const list = (items, name = 'ul') =>
    items.length
        ? h(
              name,
              {},
              items.map((item) => h('li', {}, item)),
          )
        : null;

/** A select with its label. */
export function select(label, id, options, value, change) {
    const all = options.map(([key, text]) => h('option', { value: key, selected: key === value }, text));
    const made = h('select', { id, onchange: () => change?.(made.value) }, all);
    return h('label', {}, `${label} `, made);
}

/** Says something to those who do not see what changed. */
export function say(text) {
    const status = find('status');
    // The same sentence twice is no change, and would not be read.
    status.textContent = status.textContent === text ? `${text}\u00a0` : text;
}

export const counted = (n, one, many = `${one}s`) => `${n.toLocaleString('en')} ${n === 1 ? one : many}`;

/** Lets the visitor keep a text. */
export function download(name, text) {
    const url = URL.createObjectURL(new Blob([text], { type: 'text/plain' }));
    const link = h('a', { href: url, download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

/** A button that copies, and says whether it did. */
export function copier(label, text) {
    const copy = async () => {
        try {
            await navigator.clipboard.writeText(typeof text === 'function' ? text() : text);
            say('Copied.');
            button.textContent = 'Copied';
        } catch {
            say('The browser did not let the page copy. Select the text and copy it.');
            button.textContent = 'Not copied';
        }
        setTimeout(() => (button.textContent = label), 2000);
    };
    const button = h('button', { type: 'button', onclick: copy }, label);
    return button;
}
