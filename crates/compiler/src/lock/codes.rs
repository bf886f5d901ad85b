//! The error codes of locks.

use shader_text::refusals::refusals;

refusals! {
    FILE = "lock-file":
        "preshade.lock could not be read or written.",
        "Check that the file exists and that you may read and write it.";
    SYNTAX = "lock-syntax":
        "preshade.lock is not a lock file. It was edited by hand, or contains merge markers.",
        "Take one side, or write it again with `preshade plan SCENE --one --lock`.";
    FOREIGN = "lock-foreign":
        "Another version of preshade wrote preshade.lock, with unknown keys. The original is \
         shipped.",
        "Write the lock again with `preshade plan SCENE --one --lock`.";
    MATERIAL = "lock-material":
        "preshade.lock has no entry for this material. preshade emits the variants that need no \
         scene.",
        "To add an entry, run `preshade plan SCENE --one --lock`.";
    TOOL = "lock-tool":
        "preshade.lock was measured with another version of preshade, whose shaders may differ. \
         The original is shipped.",
        "Plan again: `preshade plan SCENE --one --lock`.";
    FILES = "lock-files":
        "preshade.lock was measured for a material made of other files. The original is \
         shipped.",
        "Plan again: `preshade plan SCENE --one --lock`.";
    SOURCE = "lock-source":
        "A file was edited after preshade.lock was measured. Comments, blanks and line ends do \
         not count. The original is shipped.",
        "Plan again: `preshade plan SCENE --one --lock`.";
    DEFINES = "lock-defines":
        "The definitions differ from those that preshade.lock was measured with. The original \
         is shipped.",
        "Plan again: `preshade plan SCENE --one --lock`.";
    ENTRY_POINTS = "lock-entry-points":
        "The entry points differ from those that preshade.lock was measured with. The original \
         is shipped.",
        "Plan again: `preshade plan SCENE --one --lock`.";
    STATE = "lock-state":
        "The pipeline state differs from the one that preshade.lock was measured with. The \
         message lists the fields. The original is shipped.",
        "Plan again: `preshade plan SCENE --one --lock`.";
    STEP = "lock-step":
        "A step of the recipe in preshade.lock is now refused. The message has the refusal. The \
         original is shipped.",
        "Plan again: `preshade plan SCENE --one --lock`.";
    SHADERS = "lock-shaders":
        "The recipe in preshade.lock now produces other shaders than those measured. The \
         original is shipped.",
        "Plan again: `preshade plan SCENE --one --lock`.";
}
