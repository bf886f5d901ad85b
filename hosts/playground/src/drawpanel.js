// The panel that draws, compares and times, and makes the file of a measurement.

import { difference, FACTOR } from './draw/compare.js';
import { told } from './draw/timing.js';
import { available, draw, measure, NotDrawn } from './drawing.js';
import { code, copier, counted, download, find, h, list, marked, say, select } from './dom.js';
import { promise } from './words.js';
import { fileName, issueAddress, report } from './report.js';
import { REPOSITORY } from './repository.js';

const APIS = { webgpu: 'WebGPU', webgl: 'WebGL 2' };
const CLOCKS = {
    'gpu-timestamps': 'the GPU\u2019s own clock (timestamp queries)',
    'wall-clock': 'the CPU\u2019s clock: frame times, from submission until the GPU is done',
};

const MESHES = {
    room: 'a floor, a wall and nine spheres, drawn by one call',
    square: 'a square that fills the picture, because positions have two components',
    three: 'three vertices without a mesh, because the shader reads no attribute',
};

export class DrawPanel {
    #panel;
    #held;
    #choice = { api: null, size: '256', order: 'back-to-front', seconds: '4' };
    #has;
    #drawn;
    #timed;
    #stop;
    #isBusy = false;

    /** Another variant: what was drawn is no longer its. */
    forget() {
        this.#stop?.abort();
        this.#drawn = this.#timed = null;
    }

    async show(panel, held) {
        this.#panel = panel;
        this.#held = held;
        if (!held.variant?.plan) {
            panel.replaceChildren(h('p', {}, 'There is nothing to draw: preshade wrote no variant.'));
            return;
        }
        if (!this.#has) {
            panel.replaceChildren(h('p', {}, 'Looking for the GPU.'));
            this.#has = await available();
        }
        this.#choice.api ??= this.#has.webgpu ? 'webgpu' : 'webgl';
        this.#render();
    }

    #render() {
        const choice = this.#choice;
        const set = (key) => (value) => {
            choice[key] = value;
            this.forget();
            this.#render();
            find(`draw-${key}`).focus();
        };
        const apis = Object.entries(APIS).map(([key, name]) => [
            key,
            this.#has[key] ? name : `${name} (not in this browser)`,
        ]);
        const bar = h(
            'div',
            { class: 'bar' },
            select('Draw with', 'draw-api', apis, choice.api, set('api')),
            select(
                'Size',
                'draw-size',
                ['128', '256', '512', '1024'].map((n) => [n, `${n} x ${n}`]),
                choice.size,
                set('size'),
            ),
            select(
                'Order',
                'draw-order',
                [
                    ['back-to-front', 'far to near: much is hidden'],
                    ['front-to-back', 'near to far: little is hidden'],
                ],
                choice.order,
                set('order'),
            ),
            h('button', { type: 'button', class: 'main', id: 'draw', onclick: () => this.#draw() }, 'Draw and compare'),
        );
        this.#panel.replaceChildren(
            h(
                'p',
                {},
                h('strong', {}, 'The inputs are made up. '),
                'A mesh, values for the uniforms by their names, and textures with a checker. What you read below holds for these inputs on this device, and for no others.',
            ),
            bar,
            h('div', { id: 'draw-result' }),
        );
        this.#showResult();
    }

    get #options() {
        const { api, size, order } = this.#choice;
        return { api, size: Number(size), order, isReversed: Boolean(this.#held.material.state.reversedZ) };
    }

    async #draw() {
        if (this.#isBusy) return;
        this.#isBusy = true;
        this.forget();
        const { original, variant } = this.#held;
        const place = find('draw-result');
        place.replaceChildren(h('p', {}, 'Drawing.'));
        say('Drawing.');
        try {
            this.#drawn = await draw(original, variant, this.#options);
        } catch (error) {
            this.#drawn = { reasons: error instanceof NotDrawn ? error.reasons : [error.message] };
        }
        this.#isBusy = false;
        // The visitor may have chosen another variant meanwhile.
        if (variant !== this.#held.variant) this.#drawn = null;
        if (find('draw-result')) this.#showResult();
        if (this.#drawn)
            say(this.#drawn.reasons ? `Not drawn. ${this.#drawn.reasons.join(' ')}` : find('draw-verdict').textContent);
    }

    #showResult() {
        const place = find('draw-result');
        const drawn = this.#drawn;
        if (!drawn) {
            place.replaceChildren(h('p', { class: 'hint' }, 'Not drawn yet.'));
            return;
        }
        if (drawn.reasons) {
            place.replaceChildren(
                h(
                    'div',
                    { class: 'refusal', id: 'not-drawn' },
                    h('strong', {}, 'Not drawn.'),
                    list(drawn.reasons.map(marked)),
                ),
            );
            return;
        }
        const { error, verdict, first, second, renderer, size } = drawn;
        const picture = (texels, label, caption) => {
            const canvas = h('canvas', { width: size, height: size, role: 'img', 'aria-label': label });
            canvas.getContext('2d').putImageData(new ImageData(texels, size, size), 0, 0);
            return h('figure', {}, canvas, h('figcaption', {}, caption));
        };
        const opaque = (texels) => {
            const out = new Uint8ClampedArray(texels);
            for (let i = 3; i < out.length; i += 4) out[i] = 255;
            return out;
        };
        place.replaceChildren(
            h(
                'p',
                { id: 'draw-verdict', class: { holds: 'good', broken: 'bad' }[verdict.kind] ?? 'warn' },
                sentence(verdict, error, this.#held.variant.contract),
            ),
            h(
                'div',
                { class: 'figures' },
                picture(opaque(first.colors[0]), 'The original\u2019s picture', 'Original'),
                picture(opaque(second.colors[0]), 'The variant\u2019s picture', 'Variant'),
                picture(
                    difference(first, second),
                    error.changed_pixels
                        ? `The difference: ${counted(error.changed_pixels, 'pixel')} lit`
                        : 'The difference: all black',
                    `Difference, ${FACTOR} times as bright; black where both are the same`,
                ),
            ),
            numbers(drawn),
            drawn.notes.length ? list(drawn.notes.map(marked)) : '',
            h('p', { class: 'hint' }, `Drawn with ${renderer.name} on ${renderer.adapter.name}.`),
            h(
                'details',
                { id: 'made-up' },
                h('summary', {}, 'What was made up'),
                h('p', {}, `Mesh: ${MESHES[drawn.mesh]}. The depths of clip space are 0 to 1.`),
                list(drawn.told.map(({ name, what }) => h('span', {}, code(name), `: ${what}`))) ?? '',
            ),
            this.#timing(),
            h('div', { id: 'time-result' }),
            h('div', { id: 'send' }),
        );
        this.#showTimes();
    }

    #timing() {
        const choice = this.#choice;
        return h(
            'div',
            {},
            h('h3', {}, 'Time'),
            h(
                'p',
                {},
                `Both are drawn in turn, original, variant, variant, original, and timed by ${CLOCKS[this.#drawn.renderer.clock]}.`,
            ),
            h(
                'div',
                { class: 'bar' },
                select(
                    'For',
                    'draw-seconds',
                    ['1', '4', '10'].map((n) => [n, `${n} s`]),
                    choice.seconds,
                    (value) => (choice.seconds = value),
                ),
                h('button', { type: 'button', id: 'time', onclick: () => this.#time() }, 'Time both'),
                h(
                    'button',
                    { type: 'button', id: 'time-stop', hidden: true, onclick: () => this.#stop?.abort() },
                    'Stop',
                ),
                h('progress', { id: 'time-progress', max: '1', value: '0', hidden: true, 'aria-label': 'Timing' }),
            ),
        );
    }

    async #time() {
        if (this.#isBusy) return;
        this.#isBusy = true;
        const { original, variant } = this.#held;
        this.#stop = new AbortController();
        const { signal } = this.#stop;
        const running = (isRunning) => {
            for (const id of ['time-stop', 'time-progress']) if (find(id)) find(id).hidden = !isRunning;
            if (find('time')) find('time').disabled = isRunning;
        };
        running(true);
        say('Timing.');
        let failed = null;
        try {
            const progress = (share) => find('time-progress') && (find('time-progress').value = share);
            const seconds = Number(this.#choice.seconds);
            this.#timed = await measure(original, variant, this.#options, { seconds, progress, signal });
        } catch (error) {
            failed = error.name === 'AbortError' ? 'Stopped: there are no times.' : `Not timed: ${error.message}.`;
        }
        this.#isBusy = false;
        if (variant !== this.#held.variant || signal.aborted) this.#timed = null;
        running(false);
        if (!find('time-result')) return;
        this.#showTimes(failed);
        find('time')?.focus();
        say(failed ?? find('time-words').textContent);
    }

    #showTimes(failed = null) {
        const place = find('time-result');
        if (failed) {
            place.replaceChildren(h('p', { class: 'warn', id: 'time-words' }, failed));
            return;
        }
        this.#showSend();
        const timed = this.#timed;
        if (!timed) {
            place.replaceChildren();
            return;
        }
        const row = (name, { median, low, high }, unit) =>
            h(
                'tr',
                {},
                h('th', { scope: 'row' }, name),
                h('td', { class: 'number' }, `${median.toFixed(3)}${unit}`),
                h('td', { class: 'number' }, `${low.toFixed(3)} to ${high.toFixed(3)}`),
            );
        const isSoftware = this.#drawn.renderer.adapter.kind === 'software';
        const head = ['', 'Median', '95 % interval'].map((text) =>
            h(text ? 'th' : 'td', text ? { scope: 'col' } : {}, text),
        );
        place.replaceChildren(
            h('p', { id: 'time-words' }, told(timed.speedup)),
            h(
                'table',
                { id: 'times' },
                h('caption', {}, `Milliseconds a frame, by ${CLOCKS[timed.clock]}`),
                h('thead', {}, h('tr', {}, head)),
                h(
                    'tbody',
                    {},
                    row('Original', timed.original, ' ms'),
                    row('Variant', timed.variant, ' ms'),
                    row('Speedup', timed.speedup, 'x'),
                ),
            ),
            h(
                'p',
                { class: 'hint' },
                `${counted(timed.original.samples.length, 'sample')} of each, ${counted(timed.repeats, 'frame')} a sample; the interval is by bootstrap.`,
                isSoftware
                    ? ' This adapter draws in software, where masked lanes still run: its times say little about a GPU.'
                    : '',
            ),
        );
    }

    #showSend() {
        const drawn = this.#drawn;
        const place = find('send');
        const { material, variant } = this.#held;
        const { recipe } = variant;
        const isTold = !/not told/.test(drawn.renderer.adapter.name);
        const name = h('input', {
            type: 'text',
            id: 'adapter-name',
            value: isTold ? drawn.renderer.adapter.name : '',
            'aria-describedby': 'adapter-hint',
            oninput: () => write(),
        });
        const withText = h('input', { type: 'checkbox', id: 'with-text', onchange: () => write() });
        const output = h('textarea', {
            id: 'report',
            readonly: true,
            'aria-label': 'The measurement as JSON',
            spellcheck: 'false',
        });
        const link = h('span', {});
        const adapter = () => name.value.trim() || 'an adapter without a name';
        const write = () => {
            const made = report({
                material: material.name,
                recipe,
                contract: variant.contract,
                drawn,
                timed: this.#timed,
                adapter: adapter(),
                renderer: drawn.renderer,
                told: drawn.told,
                text: withText.checked ? material.files : null,
            });
            output.value = `${JSON.stringify(made, null, 2)}\n`;
            const address = issueAddress(REPOSITORY, { adapter: adapter(), material: material.name, recipe });
            link.replaceChildren(
                address
                    ? h(
                          'a',
                          { href: address, target: '_blank', rel: 'noopener', id: 'issue' },
                          'Open a new issue on GitHub (new tab)',
                      )
                    : 'Open a new issue where you got this page from: its build does not know the repository.',
            );
        };
        write();
        place.replaceChildren(
            h('h3', {}, 'Send in your measurement'),
            h(
                'p',
                {},
                'Nothing is sent by this page. Copy or save the JSON, which is what ',
                code('docs/results'),
                ' takes, and paste it into an issue.',
                this.#timed ? '' : ' It has no times yet: time both first if you want them in it.',
            ),
            h('div', { class: 'bar' }, h('label', {}, 'Name of your adapter ', name)),
            h(
                'p',
                { class: 'hint', id: 'adapter-hint' },
                'The browser may tell only its family. Write the model, for example \u201cNVIDIA RTX 3060\u201d.',
            ),
            h('p', {}, h('label', {}, withText, ' Put the text of the shader into it')),
            output,
            h(
                'div',
                { class: 'bar' },
                copier('Copy the JSON', () => output.value),
                h(
                    'button',
                    {
                        type: 'button',
                        id: 'save',
                        onclick: () => download(fileName(adapter(), material.name, recipe), output.value),
                    },
                    'Save the JSON',
                ),
                link,
            ),
        );
    }
}

function sentence(verdict, error, contract) {
    const isSame = !error.changed_pixels && !error.changed_depth;
    const amount = error.changed_pixels
        ? `${counted(error.changed_pixels, 'pixel')} of ${error.pixels.toLocaleString('en')} differ`
        : `${counted(error.changed_depth, 'depth')} differ`;
    if (verdict.kind === 'not-measured') return `No verdict: ${verdict.why}. ${isSame ? '' : `${amount}.`}`.trim();
    if (isSame) return 'The pictures are the same, bit for bit, for these inputs.';
    if (verdict.kind === 'holds')
        return `The variant keeps its promise for these inputs. ${amount}. ${promise(contract)}`;
    if (contract.kind === 'exact')
        return `The variant promises the exact picture, and ${amount}. Check the conditions in the plan: if they hold, this is a bug.`;
    return `The variant does not keep its promise for these inputs: ${verdict.where}. ${amount}.`;
}

function numbers({ error, first }) {
    const rows = [
        ['Pixels that differ', `${error.changed_pixels.toLocaleString('en')} of ${error.pixels.toLocaleString('en')}`],
        ['Maximum difference', `${error.max_steps} of 255`],
        ['FLIP, mean and 99th percentile', `${error.flip_mean.toFixed(4)} and ${error.flip_p99.toFixed(4)}`],
        ['Pixels beyond one step', error.beyond_step.toLocaleString('en')],
        ['Depths that differ', first.depth ? error.changed_depth.toLocaleString('en') : 'there is no depth buffer'],
        [
            'First difference',
            error.first_difference ? `column ${error.first_difference[0]}, row ${error.first_difference[1]}` : 'none',
        ],
    ];
    return h(
        'table',
        { id: 'error' },
        h('caption', {}, 'Variant against original'),
        h(
            'tbody',
            {},
            rows.map(([name, value]) =>
                h('tr', {}, h('th', { scope: 'row' }, name), h('td', { class: 'number' }, value)),
            ),
        ),
    );
}
