// Texts that read the matrices of two frames.

import assert from 'node:assert/strict';
import test from 'node:test';
import { withRows } from '../webgl/both.js';

const instanced = (body) => `attribute mat4 instanceMatrix;
attribute vec3 position;
void main() { ${body} }`;

test('instances are read from a texture', () => {
    const text = withRows(instanced('gl_Position = instanceMatrix * vec4( position, 1.0 );'));
    assert.match(text, /gl_Position = instanceMatrix_now\(\) \* vec4/);
    assert.match(text, /uniform int instanceMatrix_row;/);
    assert.doesNotMatch(text, /attribute mat4/);
});

test("a variable of that name is the author's", () => {
    const text = instanced('mat4 instanceMatrix = mat4( 2.0 ); gl_Position = instanceMatrix * vec4( position, 1.0 );');
    assert.equal(withRows(text), text);
});
