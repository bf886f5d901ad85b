//! The refusals of `specialize`.

use shader_text::refusals::refusals;

refusals! {
    NOTHING_KNOWN = "nothing-known":
        "No value of the material is known to be constant, so there is nothing to specialise by.",
        "Measure a scene, or give values by hand: `specialize:set=material.fog=0`.";
    UNFIT_VALUES = "unfit-values":
        "`set` has values that the shader's uniforms or overrides cannot have, or two values for \
         one name.",
        "Give `name=number`, joined by `+`, each name once.";
}
