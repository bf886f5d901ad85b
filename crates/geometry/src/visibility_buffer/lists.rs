//! Compute passes that list ids, so that a resolve runs only where its draw is visible: tiles by
//! draw, or pixels by instance.
//!
//! ```text
//! tiles:  cs_tiles    once, 8x8 pixels a workgroup    each draw that the tile shows gets the tile
//! bins:   cs_count    once, over the pixels           pixels of each instance
//!         cs_scan     each draw, over its instances   first place of each instance's pixels
//!         cs_scatter  once, over the pixels           each pixel to its place
//! ```
//!
//! A draw has an entry of eight words ([`preshade_plan::plan::FrameWords::Draws`]): four arguments of
//! an indirect call, the length of the list, the complement of the first index. Tiles and pixels
//! are `y << 16 | x`. Workgroups form rows of 65,535, WebGPU's largest dispatch size.

use naga::ShaderStage;

use super::text::{self, Slots};
use super::{Select, ShadingForm, VisibilityParams};
use naga_edit::declared::Declared;
use preshade_passes::rebuild::place;
use preshade_passes::rebuild::snippet::Linked;
use preshade_plan::draw_table::{IDS, Words};
use preshade_plan::geometry::{Formats, Geometry};
use preshade_plan::plan::{
    BindingKind, BindingSource, BindingUse, ComputePass, Draws, FrameBuffer, FrameWords,
    GeometryPart, Phase, Plan, When,
};
use preshade_plan::program::Program;

/// The lists of a resolve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lists {
    /// No list: all pixels of the screen.
    None,
    /// Tiles, drawn as two triangles each.
    Quads,
    /// Tiles, one per workgroup.
    Groups,
    /// Pixels, sorted by instance.
    Bins,
}

/// Side of a workgroup over pixels and of a tile, in pixels.
const SIDE: u32 = 8;
/// Size of a workgroup over instances.
const SCANNED: u32 = 256;

impl Lists {
    pub fn of(params: &VisibilityParams) -> Self {
        match (params.form, params.select()) {
            (ShadingForm::Binned, _) => Self::Bins,
            (ShadingForm::Fragment, Select::Tiles) => Self::Quads,
            (ShadingForm::Compute, Select::Tiles) => Self::Groups,
            (ShadingForm::Fragment | ShadingForm::Compute, Select::Depth | Select::Id) => {
                Self::None
            }
        }
    }

    /// Name of the buffer of entries. Forms do not share buffers, because they list different
    /// things.
    fn entries(self) -> &'static str {
        match self {
            Self::None | Self::Quads => "visibility-quads",
            Self::Groups => "visibility-groups",
            Self::Bins => "visibility-bins",
        }
    }

    /// Name of the buffer of listed items.
    fn listed(self) -> &'static str {
        match self {
            Self::None | Self::Quads => "visibility-quad-tiles",
            Self::Groups => "visibility-group-tiles",
            Self::Bins => "visibility-bin-pixels",
        }
    }

    /// The geometry or dispatch of a resolve.
    pub fn geometry(self) -> Geometry {
        match self {
            Self::None => Geometry::FullScreen,
            _ => Geometry::Indirect {
                buffer: self.entries().to_owned(),
            },
        }
    }

    /// The resolve's bindings of these buffers from `first` on, matching the text of
    /// [`Self::read`].
    pub fn bindings(self, group: u32, first: u32) -> Vec<BindingUse> {
        let buffers: &[&str] = match self {
            Self::None => &[],
            Self::Quads => &[self.listed()],
            Self::Groups | Self::Bins => &[self.listed(), self.entries()],
        };
        (first..)
            .zip(buffers)
            .map(|(binding, buffer)| bound((group, binding), of_frame(buffer)))
            .collect()
    }

    /// The resolve's code for reading lists: the vertex stage `vs_visible`, or
    /// `visible_place(group, local)`.
    pub fn read(self, group: u32, first: u32) -> String {
        let listed = format!(
            "@group({group}) @binding({first}) var<storage, read> visibility_listed: array<u32>;\n"
        );
        let entries = format!(
            "@group({group}) @binding({}) var<storage, read> visibility_entries: array<u32>;\n",
            first + 1
        );
        match self {
            Self::None => PLACE.to_owned(),
            Self::Quads => listed + TILE + QUADS,
            Self::Groups => listed + &entries + TILE + GROUPS,
            Self::Bins => listed + &entries + BINS,
        }
    }

    /// Adds the passes that fill the lists, and their buffers.
    ///
    /// # Errors
    /// Our own program does not parse or validate, which is a bug.
    pub fn add(self, plan: &mut Plan, program: &Program, words: Words) -> Result<(), String> {
        let mut buffer = |name: &str, holds| {
            plan.frame_buffers.push(FrameBuffer {
                name: name.to_owned(),
                holds,
            });
        };
        let steps: Vec<Pass> = match self {
            Self::None => return Ok(()),
            Self::Quads | Self::Groups => {
                buffer(self.entries(), FrameWords::Draws);
                buffer(self.listed(), FrameWords::Tiles);
                vec![Pass {
                    program: "tiles",
                    entry: "cs_tiles",
                    text: self.tiles(words),
                    when: Phase::Depth,
                    over: Over::Pixels,
                    reads: IndexReads::IdsAndTable,
                    buffers: vec![self.entries(), self.listed()],
                }]
            }
            Self::Bins => {
                buffer(self.entries(), FrameWords::Draws);
                buffer(self.listed(), FrameWords::Pixels);
                buffer(INSTANCES, FrameWords::Instances);
                vec![
                    Pass {
                        program: "bin-count",
                        entry: "cs_count",
                        text: texts(words, COUNT),
                        when: Phase::Depth,
                        over: Over::Pixels,
                        reads: IndexReads::IdsAndTable,
                        buffers: vec![INSTANCES],
                    },
                    Pass {
                        program: "bin-scan",
                        entry: "cs_scan",
                        text: text::entry(Slots { group: 0, first: 0 }, 0) + GROW + SCAN,
                        when: Phase::Classify,
                        over: Over::Instances,
                        reads: IndexReads::Entry,
                        buffers: vec![self.entries(), INSTANCES],
                    },
                    Pass {
                        program: "bin-scatter",
                        entry: "cs_scatter",
                        text: texts(words, SCATTER),
                        when: Phase::Resolve,
                        over: Over::Pixels,
                        reads: IndexReads::IdsAndTable,
                        buffers: vec![INSTANCES, self.listed(), self.entries()],
                    },
                ]
            }
        };
        for step in steps {
            step.add(plan, program)?;
        }
        Ok(())
    }

    fn tiles(self, words: Words) -> String {
        let arguments = match self {
            Self::Quads => {
                "    let slot = atomicAdd(&visibility_entries[draw * 8u + 1u], 1u);
    atomicMax(&visibility_entries[draw * 8u], 6u);
"
            }
            _ => {
                "    let slot = atomicAdd(&visibility_entries[draw * 8u + 4u], 1u);
    visible_grow(draw, slot + 1u);
"
            }
        };
        texts(words, ENTRIES) + GROW + TILES + arguments + TILES_END
    }
}

/// Pixel count of each instance, then the start of its pixels.
const INSTANCES: &str = "visibility-bin-instances";

struct Pass {
    program: &'static str,
    entry: &'static str,
    text: String,
    /// The phase it follows. Passes for all materials and passes of one material never share a
    /// phase, except that resolves come last in theirs.
    when: Phase,
    over: Over,
    reads: IndexReads,
    /// Frame buffers, bound after its inputs.
    buffers: Vec<&'static str>,
}

enum Over {
    /// Over the screen, once per frame.
    Pixels,
    /// Over the draw's instances.
    Instances,
}

enum IndexReads {
    /// The ids and the draw table, at 0 and 1.
    IdsAndTable,
    /// The draw's entry in the draw table, at 0.
    Entry,
}

impl Pass {
    fn add(self, plan: &mut Plan, program: &Program) -> Result<(), String> {
        let linked = Linked::new(naga::Module::default(), &self.text)?;
        let module = place::retain(&linked.module, &[(ShaderStage::Compute, self.entry)]);
        let program = program.with_module(module).map_err(|e| e.to_string())?;
        // It contains none of the author's resources, and reuses their numbers.
        let program = program.with_declared(Declared::default());
        let geometry = |part| BindingSource::Geometry { part };
        let mut sources = match self.reads {
            IndexReads::IdsAndTable => vec![
                BindingSource::Attachment {
                    name: IDS.to_owned(),
                },
                geometry(GeometryPart::DrawTable),
            ],
            IndexReads::Entry => vec![geometry(GeometryPart::Draw {
                streams: Vec::new(),
                formats: Formats::Declared,
            })],
        };
        sources.extend(self.buffers.iter().map(|b| of_frame(b)));
        let (geometry, draws, workgroup) = match self.over {
            Over::Pixels => (Geometry::FullScreen, Draws::Once, SIDE),
            Over::Instances => (Geometry::Instances, Draws::Opaque, SCANNED),
        };
        let pass = ComputePass {
            draws,
            bindings: (0..)
                .zip(sources)
                .map(|(binding, source)| bound((0, binding), source))
                .collect(),
            when: When::Behind { phase: self.when },
            ..ComputePass::new(self.program, self.entry, workgroup, geometry)
        };
        plan.add_compute(pass, program);
        Ok(())
    }
}

fn of_frame(buffer: &str) -> BindingSource {
    BindingSource::Geometry {
        part: GeometryPart::Frame {
            buffer: buffer.to_owned(),
        },
    }
}

/// A read-only buffer or texture that the plan adds.
pub(crate) fn bound((group, binding): (u32, u32), source: BindingSource) -> BindingUse {
    BindingUse::new([group, binding], BindingKind::StorageRead, source)
}

/// The ids at 0, the draw table at 1, and `more`.
fn texts(words: Words, more: &str) -> String {
    text::drawn(words) + PIXEL + more
}

const PIXEL: &str = "fn visible_pixel_id(pixel: vec3<u32>) -> u32 {
    let size = textureDimensions(visibility_ids);
    if (pixel.x >= size.x || pixel.y >= size.y) {
        return 0u;
    }
    return visible_id(vec4<f32>(vec2<f32>(pixel.xy) + 0.5, 0.0, 1.0)).x;
}
";

const ENTRIES: &str =
    "@group(0) @binding(2) var<storage, read_write> visibility_entries: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> visibility_listed: array<u32>;
";

const GROW: &str = "fn visible_grow(draw: u32, groups: u32) {
    atomicMax(&visibility_entries[draw * 8u], min(groups, 65535u));
    atomicMax(&visibility_entries[draw * 8u + 1u], (groups + 65534u) / 65535u);
    atomicMax(&visibility_entries[draw * 8u + 2u], 1u);
}
";

/// The first pixel of a tile that shows a draw appends the tile.
const TILES: &str = "var<workgroup> visibility_seen: array<u32, 64>;
@compute @workgroup_size(8, 8)
fn cs_tiles(@builtin(global_invocation_id) pixel: vec3<u32>, \
    @builtin(local_invocation_index) at: u32, @builtin(workgroup_id) tile: vec3<u32>, \
    @builtin(num_workgroups) tiles: vec3<u32>) {
    let id = visible_pixel_id(pixel);
    var draw = 0xffffffffu;
    if (id != 0u) {
        draw = visible_draw(id);
    }
    visibility_seen[at] = draw;
    workgroupBarrier();
    if (id == 0u) {
        return;
    }
    for (var i = 0u; i < at; i += 1u) {
        if (visibility_seen[i] == draw) {
            return;
        }
    }
";
const TILES_END: &str =
    "    visibility_listed[draw * tiles.x * tiles.y + slot] = (tile.y << 16u) | tile.x;
}
";

const COUNT: &str =
    "@group(0) @binding(2) var<storage, read_write> visibility_instances: array<atomic<u32>>;
@compute @workgroup_size(8, 8)
fn cs_count(@builtin(global_invocation_id) pixel: vec3<u32>) {
    let id = visible_pixel_id(pixel);
    if (id != 0u) {
        atomicAdd(&visibility_instances[id - 1u], 1u);
    }
}
";

/// A prefix sum within a workgroup (Hillis and Steele 1986). A workgroup reserves its range by
/// adding to one word behind all entries; draws run one after the other.
const SCAN: &str =
    "@group(0) @binding(1) var<storage, read_write> visibility_entries: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read_write> visibility_instances: array<u32>;
var<workgroup> visibility_sums: array<u32, 256>;
var<workgroup> visibility_base: u32;
@compute @workgroup_size(256)
fn cs_scan(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) at: u32) {
    let instance = (group.y * 65535u + group.x) * 256u + at;
    let is_any = instance < visibility.instances;
    var count = 0u;
    if (is_any) {
        count = visibility_instances[visibility.first_id + instance];
    }
    visibility_sums[at] = count;
    workgroupBarrier();
    for (var apart = 1u; apart < 256u; apart *= 2u) {
        var more = 0u;
        if (at >= apart) {
            more = visibility_sums[at - apart];
        }
        workgroupBarrier();
        visibility_sums[at] += more;
        workgroupBarrier();
    }
    let sum = visibility_sums[255];
    if (at == 0u && sum != 0u) {
        let draw = visibility.number;
        let base = atomicAdd(&visibility_entries[arrayLength(&visibility_entries) - 8u], sum);
        visibility_base = base;
        atomicMax(&visibility_entries[draw * 8u + 5u], ~base);
        let pixels = atomicAdd(&visibility_entries[draw * 8u + 4u], sum) + sum;
        visible_grow(draw, (pixels + 63u) / 64u);
    }
    workgroupBarrier();
    if (is_any) {
        visibility_instances[visibility.first_id + instance] = visibility_base + \
            visibility_sums[at] - count;
    }
}
";

/// Pixels that another form shades are skipped.
const SCATTER: &str =
    "@group(0) @binding(2) var<storage, read_write> visibility_instances: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> visibility_listed: array<u32>;
@group(0) @binding(4) var<storage, read> visibility_entries: array<u32>;
@compute @workgroup_size(8, 8)
fn cs_scatter(@builtin(global_invocation_id) pixel: vec3<u32>) {
    let id = visible_pixel_id(pixel);
    if (id != 0u && visibility_entries[visible_draw(id) * 8u + 4u] != 0u) {
        let place = atomicAdd(&visibility_instances[id - 1u], 1u);
        visibility_listed[place] = (pixel.y << 16u) | pixel.x;
    }
}
";

const TILE: &str = "fn visible_tile(slot: u32) -> vec2<u32> {
    let tiles = (textureDimensions(visibility_ids) + 7u) / 8u;
    let tile = visibility_listed[visibility.number * tiles.x * tiles.y + slot];
    return vec2<u32>(tile & 65535u, tile >> 16u);
}
";

/// Two triangles: corners 0, 1, 2 and 2, 1, 3, two bits each.
const QUADS: &str = "@vertex
fn vs_visible(@builtin(vertex_index) vertex: u32, @builtin(instance_index) slot: u32) -> \
    @builtin(position) vec4<f32> {
    let corner = (3492u >> (2u * vertex)) & 3u;
    let at = vec2<f32>((visible_tile(slot) + vec2<u32>(corner & 1u, corner >> 1u)) * 8u);
    let inside = (at - visibility.viewport.xy) / visibility.viewport.zw;
    return vec4<f32>(inside.x * 2.0 - 1.0, 1.0 - inside.y * 2.0, 0.0, 1.0);
}
";

const GROUPS: &str = "fn visible_place(group: vec3<u32>, local: vec3<u32>) -> vec3<u32> {
    let slot = group.y * 65535u + group.x;
    if (slot >= visibility_entries[visibility.number * 8u + 4u]) {
        return vec3<u32>(0xffffffffu);
    }
    return vec3<u32>(visible_tile(slot) * 8u + local.xy, 0u);
}
";

const BINS: &str = "fn visible_place(group: vec3<u32>, local: vec3<u32>) -> vec3<u32> {
    let entry = visibility.number * 8u;
    let slot = (group.y * 65535u + group.x) * 64u + local.y * 8u + local.x;
    if (slot >= visibility_entries[entry + 4u]) {
        return vec3<u32>(0xffffffffu);
    }
    let pixel = visibility_listed[~visibility_entries[entry + 5u] + slot];
    return vec3<u32>(pixel & 65535u, pixel >> 16u, 0u);
}
";

const PLACE: &str = "fn visible_place(group: vec3<u32>, local: vec3<u32>) -> vec3<u32> {
    return group * vec3<u32>(8u, 8u, 1u) + local;
}
";
