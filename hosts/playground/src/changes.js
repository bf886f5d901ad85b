// Each pass's result beside the original.

import { code, counted, h, say, select } from './dom.js';
import { Comparison } from './editors.js';

const LANGUAGES = [
    ['wgsl', 'WGSL'],
    ['glsl-es', 'GLSL ES 3.00'],
];
const narrow = matchMedia('(max-width: 56rem)');

/** What can be set beside what, in one language: label, both names and both texts. */
function pairs({ material, original, variant }, language, beside) {
    const text = (of, name) => of.files.find((file) => file.name === name)?.text;
    const out = [];
    const main = original.plan.files.find(({ role }) => role === 'main') ?? original.plan.files[0];
    for (const { role, ...stages } of variant.plan.files) {
        const seen = new Set();
        for (const stage of ['vertex', 'fragment']) {
            const file = stages[stage]?.[language]?.file;
            if (!file || seen.has(file)) continue;
            seen.add(file);
            const own = material.files[material.language === 'glsl' && stage === 'fragment' ? 1 : 0];
            const before = main[stage]?.[language]?.file ?? main.vertex[language]?.file;
            const isOwn = beside === 'yours' || (language === 'wgsl' && material.language === 'wgsl');
            out.push({
                key: file,
                label: language === 'wgsl' ? role : `${role}, ${stage} stage`,
                names: [isOwn ? own.name : `${before}, as preshade writes your text`, file],
                texts: [isOwn ? own.text : text(original, before), text(variant, file)],
                isOwn,
            });
        }
    }
    return out;
}

export class Changes {
    #comparison;
    #choice = { of: null, language: null, beside: 'written', key: null };
    #shown;

    constructor() {
        narrow.addEventListener('change', () => this.#shown && this.show(...this.#shown));
    }

    /** Nothing is shown any more. */
    clear() {
        this.#shown = null;
    }

    /** `isAsked`: the visitor chose something here, and hears what it shows. */
    show(panel, held, isAsked = false) {
        this.#shown = [panel, held];
        this.#comparison?.destroy();
        this.#comparison = null;
        const { material, variant } = held;
        if (!variant?.plan) {
            panel.replaceChildren(h('p', {}, 'There is nothing to compare: preshade wrote no variant.'));
            return;
        }
        const choice = this.#choice;
        const isGlsl = material.language === 'glsl';
        if (choice.of !== material.language) choice.language = isGlsl ? 'glsl-es' : 'wgsl';
        choice.of = material.language;
        const again = () => this.show(panel, held, true);
        const found = pairs(held, choice.language, isGlsl && choice.language === 'glsl-es' ? choice.beside : 'written');
        const pair = found.find(({ key }) => key === choice.key) ?? found[0];
        const bar = h(
            'div',
            { class: 'bar' },
            select('Language', 'diff-language', LANGUAGES, choice.language, (value) => {
                choice.language = value;
                again();
                document.getElementById('diff-language').focus();
            }),
            found.length > 0 &&
                select(
                    'Pass',
                    'diff-file',
                    found.map(({ key, label }) => [key, label]),
                    pair.key,
                    (value) => {
                        choice.key = value;
                        again();
                        document.getElementById('diff-file').focus();
                    },
                ),
            isGlsl &&
                choice.language === 'glsl-es' &&
                select(
                    'Beside',
                    'diff-beside',
                    [
                        ['written', 'your text as preshade writes it'],
                        ['yours', 'your text'],
                    ],
                    choice.beside,
                    (value) => {
                        choice.beside = value;
                        again();
                        document.getElementById('diff-beside').focus();
                    },
                ),
        );
        if (!pair) {
            panel.replaceChildren(bar, h('p', {}, 'preshade wrote no shader in this language. The reason is above.'));
            return;
        }
        const place = h('div', { class: narrow.matches ? 'unified' : 'split' });
        const words = h('p', { id: 'diff-words' });
        const step = (label, go) => h('button', { type: 'button', onclick: go }, label);
        bar.append(
            step('Previous change', () => this.#comparison.previous()),
            step('Next change', () => this.#comparison.next()),
        );
        const names = h('p', { class: 'hint' }, 'Left: ', code(pair.names[0]), '. Right: ', code(pair.names[1]), '.');
        if (narrow.matches)
            names.replaceChildren('From ', code(pair.names[0]), ' to ', code(pair.names[1]), ', in one column.');
        panel.replaceChildren(bar, words, names, place);
        this.#comparison = new Comparison(place, {
            before: pair.texts[0],
            after: pair.texts[1],
            language: choice.language === 'wgsl' ? 'wgsl' : 'glsl',
            labels: [`Before: ${pair.names[0]}`, `After: ${pair.names[1]}`],
            split: !narrow.matches,
        });
        const { places, removed, added } = this.#comparison.counts;
        const whose = pair.isOwn ? 'your text' : 'your text as preshade writes it';
        words.textContent =
            pair.texts[0] === pair.texts[1]
                ? `This shader is ${whose}, byte for byte.`
                : `${counted(places, 'place')} differ: ${counted(removed, 'line')} out, ${counted(added, 'line')} in.`.replace(
                      '1 place differ',
                      '1 place differs',
                  );
        if (isAsked) say(words.textContent);
    }
}
