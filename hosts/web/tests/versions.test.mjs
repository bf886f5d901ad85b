import assert from 'node:assert/strict';
import test from 'node:test';
import { dispatch } from '../versions.js';

const flags = (low, high) => ({
    name: 'material.flags',
    place: { from: 'uniform', group: 0, binding: 1, offset: 4 },
    type: 'u32',
    low,
    high,
});
const fog = { ...flags(0, 0.5), name: 'fog', type: 'f32', place: { from: 'uniform', group: 0, binding: 1, offset: 8 } };
const white = {
    ...flags(1, 1),
    name: 'map.r',
    type: 'f32',
    place: { from: 'texture', group: 0, binding: 2, channel: 0 },
};
const versions = {
    material: 'lit',
    versions: [
        { name: 'lit-2', guard: { values: [flags(3, 3), white] }, operations: 10, draws: [1] },
        { name: 'lit-1', guard: { values: [flags(0, 3), fog] }, operations: 20, draws: [0, 2] },
    ],
};

/** 4 bytes, the flags, and the fog. */
function content(flags, fog = 0) {
    const data = new DataView(new ArrayBuffer(12));
    data.setUint32(4, flags, true);
    data.setFloat32(8, fog, true);
    return data;
}

test('the cheapest version whose guard holds is taken', () => {
    const choose = dispatch(versions);
    const name = (data, isWhite) =>
        choose(
            (group, binding) => (group === 0 && binding === 1 ? data : undefined),
            (value) => isWhite && value.name === 'map.r',
        )?.name;
    for (const _ of [1, 2]) {
        assert.equal(name(content(3), true), 'lit-2');
        assert.equal(name(content(3), false), 'lit-1');
        assert.equal(name(content(1), true), 'lit-1');
        assert.equal(name(content(1, 0.75), true), undefined);
        assert.equal(name(content(1, NaN), true), undefined);
        assert.equal(name(content(4), true), undefined);
    }
    // Any view of the bytes, and none.
    assert.equal(name(new Uint8Array(content(3).buffer), true), 'lit-2');
    assert.equal(name(content(3).buffer, true), 'lit-2');
    assert.equal(name(new Uint8Array(7), true), undefined);
    assert.equal(name(undefined, true), undefined);
});

test('a texture that nobody vouches for is no white one', () => {
    assert.equal(dispatch(versions)(() => content(3))?.name, 'lit-1');
});

test('a draw whose values were seen before is not checked again', () => {
    let checks = 0;
    const counted = (value) => ({
        ...value,
        get low() {
            checks++;
            return value.low;
        },
    });
    const [, { guard, ...rest }] = versions.versions;
    const choose = dispatch({ material: 'lit', versions: [{ ...rest, guard: { values: guard.values.map(counted) } }] });
    assert.equal(choose(() => content(1)).name, 'lit-1');
    const before = checks;
    assert.ok(before > 0);
    assert.equal(choose(() => content(1)).name, 'lit-1');
    assert.equal(checks, before);
});
