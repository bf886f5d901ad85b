// Compiles WGSL files with Tint. Paths come on stdin, one a line; the last line of stdout is one JSON array, behind what Dawn prints of warnings:
// [{"path": .., "errors": [{"line": .., "column": .., "message": ..}]}]. Exits 0 whatever Tint says of the files.
import { readFileSync } from 'node:fs';
import { create, globals } from 'webgpu';

Object.assign(globalThis, globals);

const gpu = create(['backend=null', 'enable-dawn-features=allow_unsafe_apis']);
const adapter = await gpu.requestAdapter();
if (!adapter) {
  throw new Error('Dawn has no null adapter');
}
const device = await adapter.requestDevice({ requiredFeatures: [...adapter.features] });
// Errors are read from each module below; this keeps Dawn from printing them as well.
device.addEventListener('uncapturederror', (event) => event.preventDefault());

const paths = readFileSync(0, 'utf8').split('\n').filter((path) => path !== '');
const results = [];
for (const path of paths) {
  const module = device.createShaderModule({ code: readFileSync(path, 'utf8') });
  const info = await module.getCompilationInfo();
  results.push({
    path,
    errors: info.messages
      .filter((message) => message.type === 'error')
      .map((message) => ({
        line: message.lineNum,
        column: message.linePos,
        message: message.message,
      })),
  });
}
// Dawn's threads keep node alive; leave once the pipe has taken everything.
process.stdout.write(`\n${JSON.stringify(results)}`, () => process.exit(0));
