import type { Scene } from 'three';
import type { Options, Preshade as Host, Row } from './index.js';

export interface PreshadeProps {
    /** True, or the options of `preshade.shadows`. */
    shadows?: boolean | object;
    /** True, or the options of `preshade.prepass`. */
    prepass?: boolean | object;
    /** True, or the options of `preshade.velocity`. */
    velocity?: boolean | object;
    /** Another scene than the canvas's. */
    scene?: Scene;
    /** Those of `Preshade.of`. */
    options?: Options;
    /** Called when the parts are there: nothing is derived yet. */
    onReady?: (made: { preshade: Host; shadows?: object; prepass?: object; velocity?: object }) => void;
    /** Called with the rows of the report whenever they are others. */
    onReport?: (rows: Row[]) => void;
    /** By default errors go to the console. */
    onError?: (error: Error) => void;
}

/** preshade in a scene of `@react-three/fiber`. It draws nothing. */
export declare function Preshade(props: PreshadeProps): null;
