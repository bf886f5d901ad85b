import type { Scene } from 'three';
import type {
    Options,
    OverrideOptions,
    Part,
    Prepass,
    PrepassOptions,
    Preshade as Host,
    Rewrite,
    RewriteOptions,
    Row,
    ShadowOptions,
    Velocity,
    VelocityOptions,
} from './index.js';

/**
 * Lists and plain objects in options are compared by what is in them, all else by identity; a function counts as the same
 * in each render. If anything but `onReady`, `onReport` and `onError` is another, everything is made anew; another `key` of the
 * component does it, too.
 */
export interface PreshadeProps {
    /** True, or the options of `preshade.shadows`. */
    shadows?: boolean | ShadowOptions;
    /** True, or the options of `preshade.prepass`. */
    prepass?: boolean | PrepassOptions;
    /** The options of `preshade.rewrite`. */
    rewrite?: RewriteOptions;
    /** True, or the options of `preshade.velocity`. */
    velocity?: boolean | VelocityOptions;
    /** A pass for `preshade.override`, or a list of passes. In a list, `[pass, options]` gives the options of one. */
    override?: object | (object | [pass: object, options?: OverrideOptions])[];
    /** Another scene than the canvas's. */
    scene?: Scene;
    /** Those of `Preshade.of`. */
    options?: Options;
    /** Called when the parts are there: nothing is derived yet. */
    onReady?: (made: Made) => void;
    /** Called with the rows of the report whenever they are others. */
    onReport?: (rows: Row[]) => void;
    /** By default errors go to the console. */
    onError?: (error: Error) => void;
}

/** What the component made: `preshade`, and what the function of each property returned. */
export interface Made {
    preshade: Host;
    shadows?: Part;
    prepass?: Prepass;
    rewrite?: Rewrite;
    velocity?: Velocity;
}

/** preshade in a scene of `@react-three/fiber`. It draws nothing. */
export declare function Preshade(props: PreshadeProps): null;
