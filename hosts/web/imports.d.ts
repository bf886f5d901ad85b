// Types of imports with the query `?preshade=PASS`: put `/// <reference types="preshade/imports" />` into a file.

interface PreshadeVariant {
    material: string;
    recipe: string;
    contract: unknown;
    refusals: import('preshade').Refusal[];
    notes: string[];
    /** Texts by name. */
    files: Record<string, string>;
    plan: any;
}

declare module '*?preshade' {
    const variant: PreshadeVariant;
    export default variant;
}
declare module '*?preshade=depth-prepass' {
    const variant: PreshadeVariant;
    export default variant;
}
declare module '*?preshade=early-discard' {
    const variant: PreshadeVariant;
    export default variant;
}
declare module '*?preshade=early-alpha' {
    const variant: PreshadeVariant;
    export default variant;
}
declare module '*?preshade=shadow' {
    const variant: PreshadeVariant;
    export default variant;
}
declare module '*?preshade=specialize' {
    const variant: PreshadeVariant;
    export default variant;
}
