// By what each material is drawn: recipes as `preshade.rewrite` takes them; `of` has those of materials that want another. `fallback` is tried where the recipe is refused, or its self-test fails.

export const VARIANTS = [
    {
        name: 'prepass-equal',
        label: 'Depth pre-pass, EQUAL',
        recipe: 'depth-prepass:form=equal',
        fallback: 'depth-prepass',
    },
    {
        name: 'prepass-biased',
        label: 'Depth pre-pass, biased',
        recipe: 'depth-prepass',
    },
    {
        name: 'early-discard',
        label: 'Early discard',
        recipe: 'early-discard:texture=float,quad=lane,budget=0.004',
        // Its derivatives cannot be taken first: a vote, which GLSL ES has no derivatives fine enough to promise anything of.
        of: { bronze: 'early-discard:texture=float' },
    },
    {
        name: 'hoist',
        label: 'Hoist, exact and rounding',
        recipe: 'hoist',
    },
    {
        name: 'hoist-budget',
        label: 'Hoist, within a budget',
        recipe: 'hoist',
        // The stone's weathering changes slowly; what the others would carry (where in a hexagon a point lies) does not, and nothing here measures it.
        of: { stone: 'hoist:budget=0.05,metric=max_abs,jumps=carried' },
    },
    {
        name: 'hoist-prepass',
        label: 'Hoist, then pre-pass',
        recipe: ['hoist', 'depth-prepass'],
    },
];
