// Rows of a report: the same for both renderers, and short.

import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import test from 'node:test';
import * as three from 'three';
import { COMPARE, compareName } from '../compare.js';
import { passName, planRow, REMEDIES, row, withoutVelocity } from '../rows.js';

const material = { name: 'leaf', type: 'MeshBasicMaterial', uuid: '0' };
const read = (name) => readFileSync(new URL(`../${name}`, import.meta.url), 'utf8');
const found = (on, known = true) => ({ on, known, ratio: 0.81234, low: 0.8, high: on ? 0.9 : 1.1, frames: 32 });
const planned = (more) => ({
    state: 'ready',
    recipe: { name: 'depth-prepass:form=equal', form: 'equal' },
    verdicts: ['kept'],
    skipped: [{ pass: 'hoist', reason: 'nothing pays' }],
    failures: [],
    plan: { passes: [{}, {}] },
    ms: 180.4,
    ...more,
});

test('all rows have the same fields in the same order, and short values only', () => {
    const rows = [
        row('shadow', material, { state: 'done', left_out: [{ what: 'a fade' }] }),
        row('override', material, { isCurrent: false, mode: 'MeshNormalMaterial', state: 'pending', of: 'GTAOPass' }),
        planRow('prepass', material, planned(), { measured: found(true) }),
    ];
    for (const each of rows) {
        assert.deepEqual(Object.keys(each), Object.keys(rows[0]));
        for (const [name, value] of Object.entries(each)) assert.ok(Object(value) !== value, name);
    }
    assert.equal(rows[0].left_out.length, 1);
    assert.deepEqual([rows[2].ms, rows[2].ratio, rows[2].plan.passes.length], [180, 0.812, 2]);
    assert.deepEqual(rows[2].skipped, ['hoist: nothing pays']);
});

test('while it is measured a row says so, and then whether it is drawn and why not', () => {
    const told = (measured) => {
        const { state, code, reason } = planRow('prepass', material, planned(), { measured });
        assert.equal(state === 'done', reason === null);
        return [state, code];
    };
    assert.deepEqual(told(undefined), ['done', null]);
    assert.deepEqual(told(null), ['measuring', null]);
    assert.deepEqual(told(found(true)), ['done', null]);
    assert.deepEqual(told(found(false)), ['off', 'no-gain']);
    assert.deepEqual(told(found(false, false)), ['off', 'not-timed']);
    // What cannot be drawn is not measured.
    assert.equal(planRow('prepass', material, planned({ state: 'refused' }), { measured: null }).state, 'refused');
});

test('self-tests', () => {
    const broken = planned({ state: 'original', verdicts: ['broken (equal): it differs'] });
    const { state, code, reason, remedy } = planRow('prepass', material, broken);
    assert.deepEqual([state, code, reason], ['refused', 'self-test', 'broken (equal): it differs']);
    assert.equal(remedy, REMEDIES['self-test']);
    for (const state of ['testing', 'unseen'])
        assert.equal(planRow('prepass', material, planned({ state, verdicts: ['unseen'] })).state, 'waiting');
});

test('velocities have rows of what they leave out', () => {
    const of = (name, more) => ({ isMaterial: true, name, ...more });
    const glass = of('glass', { transparent: true });
    const objects = [
        { isMesh: true, material: of('wall') },
        { isMesh: true, material: [glass, glass] },
        { isPoints: true, material: of('sparks') },
        { isGroup: true },
    ];
    const scene = { traverse: (each) => objects.forEach(each) };
    const rows = withoutVelocity(scene, ({ transparent }) => !transparent);
    assert.deepEqual(
        rows.map(({ pass, material, state, code }) => [pass, material, state, code]),
        [
            ['velocity', 'glass', 'refused', 'transparent'],
            ['velocity', 'sparks', 'refused', 'object'],
        ],
    );
});

test('a pass is called as the page says, else by what no bundle shortens', () => {
    class Pass {}
    assert.equal(passName(new Pass(), { name: 'occlusion' }), 'occlusion');
    assert.equal(passName({ name: 'NormalPass' }), 'NormalPass');
    assert.equal(passName(new Pass()), 'Pass');
});

/** A reason in a source: a text, or a variable. */
const REASON = /(?:'[^'\n]* [^'\n]*'|`[^`]*`|reason|message|unfit)/.source;
/** Where a source has a code: by name, after a state and a reason, or ahead of a reason. The state `same` has none. */
const CODES = [
    /\bcode(?::| \?\?) '([\w-]+)'/,
    new RegExp(`(?:'(?:refused|failed|unsupported)'|\\bstate),\\s*${REASON},\\s*'([\\w-]+)'`),
    new RegExp(`(?:\\[\\s*|\\bfailure\\()'(?!same')([\\w-]+)',\\s*${REASON}\\s*[\\])]`),
].map(({ source }) => new RegExp(source, 'g'));

/** The codes in the scripts of some folders, each with a file that has it. */
function codesIn(...folders) {
    const files = folders.flatMap((folder) =>
        readdirSync(new URL(`../${folder}/`, import.meta.url))
            .filter((name) => name.endsWith('.js'))
            .map((name) => `${folder}/${name}`),
    );
    return new Map(
        files.flatMap((file) => {
            const text = read(file);
            return CODES.flatMap((each) => [...text.matchAll(each)].map(([, code]) => [code, file]));
        }),
    );
}

test('each code of the package is in the README, says what to do, and is given somewhere', () => {
    const codes = Object.keys(REMEDIES).sort();
    const [, table] = /^\| `code` .*\n\|[- |]+\n((?:\|.*\n)+)/m.exec(read('README.md'));
    assert.deepEqual([...table.matchAll(/^\| `([\w-]+)` /gm)].map(([, code]) => code).sort(), codes);
    const own = codesIn('.', 'webgl', 'webgpu');
    // What is pending when the host is disposed of; its report is gone then.
    own.delete('disposed');
    for (const [code, file] of own) assert.ok(REMEDIES[code], `${file}: ${code}`);
    // Those of the package `preshade` that have a remedy here.
    const theirs = codesIn('../web');
    assert.deepEqual(
        codes.filter((code) => !own.has(code) && !theirs.has(code)),
        [],
    );
});

test('depth functions have the numbers of three.js', () => {
    const constant = (name) => three[`${name.replace(/(^|-)(\w)/g, (_, __, letter) => letter.toUpperCase())}Depth`];
    for (const [name, number] of Object.entries(COMPARE)) {
        assert.equal(constant(name), number, name);
        assert.equal(compareName(number), name);
    }
    assert.equal(new Set(Object.values(COMPARE)).size, 8);
});
