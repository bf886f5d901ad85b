// What a user writes, for the type checker alone.

/// <reference path="../../imports.d.ts" />
import { agree, explain, outputs, passes, Preshade, PreshadeError, rewrite, type Variant } from 'preshade';
import { rewrite as rewriteSync } from 'preshade/sync';
import { withThree } from 'preshade/three-prefix';
import preshade from 'preshade/vite';
import lit from './lit.wgsl?preshade=depth-prepass';
import { dispatch, type Versions } from 'preshade/versions';

const options = { pass: ['depth-prepass', 'hoist:budget=0.02'], emit: ['wgsl', 'glsl-es'] } as const;

export async function use(wgsl: string): Promise<string[]> {
    const variant: Variant = await rewrite(wgsl, { ...options, pass: [...options.pass], emit: [...options.emit] });
    const now: Variant = rewriteSync(withThree({ vertex: '', fragment: '' }), {
        pass: 'depth-prepass',
        define: { A: 1 },
    });
    const compiler = new Preshade({ timeout: 1000 });
    const { stages } = await compiler.explain([{ name: 'a.vert', text: '', stage: 'vertex' }]);
    const more = await outputs(wgsl, { write: 'normal+depth', parameters: { view: 'drop' } });
    const { agrees } = await agree(wgsl, wgsl, { as: 'prepass', with: { vertex: 'vs' }, map: { a: 'b' } });
    try {
        await explain({ 'lit.wgsl': wgsl }, { files: new Map([['a.glsl', '']]), cull: 'none', samples: 4 });
    } catch (error) {
        if (error instanceof PreshadeError) return [error.code, `${error.place?.line}`, error.rendered];
    }
    // @ts-expect-error: there is no such target.
    await rewrite(wgsl, { emit: 'hlsl' });
    // @ts-expect-error: a relation is needed.
    await agree(wgsl, wgsl, {});
    compiler.dispose();
    const text: string = lit.files['lit.main.wgsl'];
    const names = (await passes()).map((pass) => pass.name);
    return [
        text,
        ...names,
        ...now.files.map((file) => file.text),
        more.recipe,
        stages[0].stage,
        `${agrees}`,
        variant.recipe,
    ];
}

export const plugin = preshade({ pass: 'depth-prepass', strict: true, compiler: { timeout: 5000 } });

declare const museum: Versions;
const choose = dispatch(museum);
const chosen: string | undefined = choose(
    (group, binding) => (group + binding ? new Float32Array(4) : undefined),
    ({ place }) => place.from === 'texture',
)?.name;
void chosen;
