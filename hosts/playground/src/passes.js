// The list of passes: which apply, and why others do not.

import { counted, find, h } from './dom.js';

/** What a pass is worth here: the recipe that tries it, and a word. */
function standing({ pass, sites, saved, within_budget: within, refusals }) {
    const save = (of) => `saves ${Math.round(of.ops)} of ${Math.round(of.of)} ops of the ${of.stage} stage`;
    if (sites.length) return { recipe: pass, kind: 'good', word: 'applies', more: saved ? save(saved) : '' };
    if (within)
        return {
            recipe: within.step,
            kind: 'good',
            word: 'applies with an error budget',
            more: within.saved ? save(within.saved) : '',
        };
    return { recipe: pass, kind: 'warn', word: 'does not apply', more: refusals[0]?.code ?? '' };
}

const ORDER = { good: 0, warn: 1 };

/** Shows the list. `choose` is called with a recipe. */
export function showPasses(explained, recipe, choose) {
    const rows = explained.passes.map((pass) => ({ ...pass, ...standing(pass) }));
    rows.sort((a, b) => ORDER[a.kind] - ORDER[b.kind]);
    const isListed = rows.some((row) => row.recipe === recipe);
    const radio = (value, isChecked) =>
        h('input', { type: 'radio', name: 'pass', value, checked: isChecked, onchange: () => choose(value) });
    const own = h('input', {
        type: 'text',
        id: 'own-recipe',
        value: isListed ? '' : recipe,
        placeholder: 'specialize:set=fog=0 depth-prepass',
        'aria-label': 'Own recipe: passes with their parameters, separated by spaces',
        onfocus: () => (ownRadio.checked = true),
        onchange: () => choose(own.value.trim()),
    });
    const ownRadio = h('input', {
        type: 'radio',
        name: 'pass',
        value: '',
        checked: !isListed,
        'aria-label': 'Own recipe',
        onchange: () => own.value.trim() && choose(own.value.trim()),
    });
    const field = h(
        'fieldset',
        { class: 'pass-list' },
        h('legend', {}, 'Choose one to see what it changes'),
        rows.map((row) =>
            h(
                'label',
                { class: 'pass', 'data-pass': row.pass },
                radio(row.recipe, row.recipe === recipe),
                h('span', {}, h('strong', {}, row.recipe), h('span', { class: `badge ${row.kind}` }, row.word)),
                h('span', { class: 'what' }, [row.more, row.summary].filter(Boolean).join(': ')),
            ),
        ),
        h(
            'div',
            { class: 'pass' },
            ownRadio,
            h('span', {}, h('strong', {}, 'Own recipe')),
            h('span', { class: 'what' }, own),
        ),
    );
    const costs = explained.stages.map(({ stage, entry_point: name, cost, effects }) =>
        h(
            'li',
            {},
            `${stage} stage `,
            h('code', {}, name),
            `: ${counted(cost, 'op')}${effects.length ? `, ${effects.join(', ')}` : ''}`,
        ),
    );
    find('pass-list').replaceChildren(
        field,
        h(
            'p',
            { class: 'hint' },
            'An op is about the work of adding two floats; a texture sample counts 32. Ops are not times.',
        ),
        h('ul', { class: 'hint' }, costs),
    );
}
