// The declarations compile, and a typical use of them.

import assert from 'node:assert/strict';
import { join } from 'node:path';
import test from 'node:test';
import { PACKAGE, run } from './support.mjs';

test('the declarations compile', async () => {
    const tsc = join(PACKAGE, 'node_modules/typescript/bin/tsc');
    const { status, stdout } = await run(process.execPath, [tsc, '--project', 'tests/types'], { cwd: PACKAGE });
    assert.equal(status, 0, stdout);
});
