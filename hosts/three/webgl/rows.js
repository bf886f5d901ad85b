// What of a material's plans is in the report.

const WORDS = { pending: 'pending', compiling: 'pending', testing: 'pending', original: 'refused', ready: 'done' };

export function rowOf(part, material) {
    return {
        pass: part,
        material: material.name || material.type,
        uuid: material.uuid,
        remedy: null,
        code: null,
        ms: 0,
    };
}

/** One row for each plan. `last` is the frame in which one of them was last in use. */
export function rowsOf(part, material, plans, found) {
    const row = rowOf(part, material);
    if (plans.length === 0) return [{ ...row, state: 'waiting', reason: 'not drawn yet' }];
    const last = Math.max(...plans.map(({ used }) => used));
    return plans.map((planned) => {
        const isBroken = planned.state === 'original';
        return {
            ...row,
            state: WORDS[planned.state] ?? planned.state,
            reason: planned.reason ?? (isBroken ? planned.verdicts.at(-1) : null),
            remedy: planned.remedy ?? null,
            code: planned.code ?? (isBroken ? 'self-test' : null),
            ms: planned.ms,
            recipe: planned.recipe?.name ?? null,
            form: planned.recipe?.form,
            skipped: planned.skipped.map(({ pass, reason }) => `${pass}: ${reason}`),
            selfTest: planned.verdicts.join(', ') || null,
            failures: [...planned.failures],
            plan: planned.plan,
            // Lights, fog or another target give a material another program: then this is the one of the last frame.
            isCurrent: planned.used === last,
            ...found(planned),
        };
    });
}
