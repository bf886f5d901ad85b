// Tabs, by keyboard as well: arrows move, Home and End go to the ends.

import { find, h } from './dom.js';

export class Tabs {
    #names;
    #opened;
    current;

    /** `tabs` is a list of `[key, label]`. `opened` is called with the key and the panel whenever one is shown. */
    constructor(tabs, opened) {
        this.#names = tabs.map(([key]) => key);
        this.#opened = opened;
        this.current = this.#names[0];
        for (const [key, label] of tabs) {
            const tab = h(
                'button',
                {
                    type: 'button',
                    role: 'tab',
                    id: `tab-${key}`,
                    'aria-controls': `panel-${key}`,
                    onclick: () => this.open(key),
                    onkeydown: (event) => this.#key(event, key),
                },
                label,
            );
            find('tabs').append(tab);
            find('panels').append(
                h('div', { role: 'tabpanel', id: `panel-${key}`, 'aria-labelledby': `tab-${key}`, tabindex: '0' }),
            );
        }
        this.#mark();
    }

    panel(key) {
        return find(`panel-${key}`);
    }

    open(key) {
        this.current = key;
        this.#mark();
        this.#opened(key, this.panel(key));
    }

    #mark() {
        for (const name of this.#names) {
            const isOpen = name === this.current;
            find(`tab-${name}`).setAttribute('aria-selected', isOpen);
            find(`tab-${name}`).tabIndex = isOpen ? 0 : -1;
            this.panel(name).hidden = !isOpen;
        }
    }

    #key(event, key) {
        const at = this.#names.indexOf(key);
        const last = this.#names.length - 1;
        const to = { ArrowRight: at === last ? 0 : at + 1, ArrowLeft: at === 0 ? last : at - 1, Home: 0, End: last }[
            event.key
        ];
        if (to === undefined) return;
        event.preventDefault();
        this.open(this.#names[to]);
        find(`tab-${this.#names[to]}`).focus();
    }
}
