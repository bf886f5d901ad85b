//! The error codes of the renderer.

use shader_text::refusals::refusals;

refusals! {
    NO_ADAPTER = "no-adapter":
        "There is no graphics adapter, or none whose name, driver or backend contains the text \
         of `--adapter`.",
        "`preshade adapters` lists them.";
    DEVICE_LOST = "device-lost":
        "The driver gave up the device, usually because a draw took too long. Earlier \
         measurements are kept.",
        "`--limits seconds=N` measures each variant in a process of its own and ends it in \
         time.";
    SHARED_ADAPTER = "shared-adapter":
        "Processes that share an adapter take turns by a lock on a file in the folder for temporary files, \
         and the system refused the lock.",
        "Set TMPDIR to a folder whose file system has locks.";
    NO_FEATURE = "no-feature":
        "The adapter lacks a feature or a format that the plan needs. `preshade adapters` lists \
         the features of each.",
        "Choose another adapter or another form of the pass.";
    DRIVER_REFUSED = "driver-refused":
        "wgpu or the driver rejected a request of preshade.",
        "If preshade wrote the shader, this is a bug: please report it with the message.";
    OUT_OF_MEMORY = "out-of-memory":
        "The adapter has too little memory for the scene at this size.",
        "Use a smaller `--size` or smaller textures.";
    ENDLESS = "endless-loop":
        "A loop of which no end is proved took more than 32,768 turns in some invocation, in a copy that \
         leaves it then. The shader itself was not drawn: a loop without end hangs a GPU. A lane outside \
         of a triangle counts too, whose varyings lie beyond those at the corners.",
        "Give the loop a counter with a constant bound, or the scene values with which it ends.";
    FRAME = "frame":
        "The plans of a scene's materials do not fit into one frame. For example, two of them \
         need one attachment with different contents.",
        "The message names them. Take other passes for one of them.";
    DRAW = "draw":
        "A draw of the scene lacks a value that its material reads, or gives it one of another \
         type. The message names the draw.",
        "docs/reference/scenes.md lists the keys of a draw.";
    DRAWS = "draws":
        "The draws of the scene together exceed the IDs or buffers of a frame.",
        "Split the scene, or draw fewer triangles or instances.";
    ATTACHMENT = "attachment":
        "The plan asks for an attachment that the adapter can't create: a format it can't draw \
         to, or a size of 0.",
        "Choose another adapter or another form of the pass.";
    FRAME_SIZE = "frame-size":
        "The frame has no pixels, or more than the adapter can hold.",
        "Set its size with `--size WIDTHxHEIGHT`.";
}
