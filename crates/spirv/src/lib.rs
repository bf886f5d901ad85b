//! Reads SPIR-V modules with naga's reader, in this order:
//!
//! 1. `listing` reads the words and lists them as text, and `order` checks them;
//! 2. `prune` selects the stages, and `unsupported` refuses features that cannot be read;
//! 3. `blocks`, `body`, `combined`, `constants`, `exits`, `instructions`, `interface`, `layout`,
//!    `members`, `pointers`, `precise`, `switches` and `varyings` replace constructs that naga's reader
//!    lacks or misreads;
//! 4. `names` makes identifiers, and `loops` and `parameters` normalise the IR.
#![warn(missing_docs)]

mod blocks;
mod body;
mod combined;
mod constants;
mod exits;
pub mod instructions;
mod interface;
mod layout;
mod listing;
mod loops;
mod members;
mod names;
mod order;
mod parameters;
mod pointers;
mod precise;
mod prune;
mod switches;
mod unsupported;
mod varyings;
pub mod words;

use std::cell::Cell;
use std::collections::HashMap;
use std::rc::Rc;

use naga::front::spv;
use naga::{Module, ShaderStage, Span};
use naga_edit::declared::Declared;
use rspirv::binary::Assemble;
use rspirv::dr::{self, Builder};
use rspirv::spirv::{ExecutionModel, Op, Word};
use shader_text::source::SourceMap;

use self::combined::Places;
use self::listing::Listing;
use naga_edit::{
    beyond_wgsl, binding_arrays, killed_loops, lengths as length_constants, map_spans, wrapped_main,
};
use shader_text::error::{Code, Error};

/// The first word of a module.
const MAGIC: u32 = 0x0723_0203;

/// The words of a module in either byte order. `None` for anything else.
pub fn words(bytes: &[u8]) -> Option<Vec<u32>> {
    let (all, rest) = bytes.as_chunks::<4>();
    let read: fn([u8; 4]) -> u32 = match all.first().copied()? {
        first if u32::from_le_bytes(first) == MAGIC => u32::from_le_bytes,
        first if u32::from_be_bytes(first) == MAGIC => u32::from_be_bytes,
        _ => return None,
    };
    // The extra word makes the parser report the remaining bytes.
    let rest = (!rest.is_empty()).then_some(0);
    Some(all.iter().copied().map(read).chain(rest).collect())
}

/// The listing of a module, to which messages refer.
pub fn listed(words: &[u32]) -> String {
    listing::read(words).0.text
}

/// A module of one or both stages.
pub struct Words<'a> {
    /// Name in messages.
    pub name: &'a str,
    /// The module's words.
    pub words: &'a [u32],
    /// The only stage to read. `None`: both.
    pub stage: Option<ShaderStage>,
    /// Offset of the module's listing in the source map.
    pub base: u32,
}

/// Parses modules in order. Spans refer to the source map, to which files from debug information
/// are added. `names` selects the entry points if a stage has several. An entry point `main`
/// becomes `vertex_main` or `fragment_main`.
pub fn parse(
    sources: &[Words<'_>],
    names: [Option<&str>; 2],
    map: &mut SourceMap,
) -> Result<(Vec<Module>, Declared), Error> {
    let mut stages = Vec::new();
    for source in sources {
        let (listing, read) = listing::read(source.words);
        let module = read.map_err(|why| {
            let why = why.trim_end_matches('.');
            Error::new(
                Code::Parse,
                format!("{} is no valid SPIR-V: {why}", source.name),
            )
            .note("the file may be cut off or damaged: `spirv-val` checks it")
        })?;
        check_stages(&module, source.name)?;
        let files = listing.files.iter();
        let files = files.map(|file| match file.text.is_empty() {
            true => None,
            false => Some(map.add_imported(&file.name, &file.text)),
        });
        let text = Text {
            base: source.base,
            files: files.collect(),
            listing,
            became: HashMap::new(),
        };
        stages.push((source, module, text));
    }
    let mut places = Places::default();
    let mut declared = Declared {
        y_down: true,
        ..Declared::default()
    };
    for (source, module, _) in &mut stages {
        let stage = source.stage.and_then(model);
        prune::prune(module, prune::Chosen { stage, names });
    }
    let mut modules: Vec<_> = stages
        .iter_mut()
        .map(|(_, m, _)| std::mem::take(m))
        .collect();
    members::complete(&mut modules);
    for ((_, module, _), complete) in stages.iter_mut().zip(modules) {
        *module = complete;
        places.take(module);
    }
    let lengths = constants::Lengths::of(stages.iter().map(|(_, module, _)| module));
    for constant in lengths.finals(stages.iter().map(|(_, module, _)| module)) {
        length_constants::record(constant, &mut declared);
    }
    let mut modules = Vec::new();
    for (_, module, mut text) in stages {
        modules.push(one(
            module,
            &mut text,
            &mut places,
            &lengths,
            &mut declared,
        )?);
    }
    let kept = lengths.kept.into_values();
    declared.lengths.extend(kept.map(|(length, _)| length));
    interface::match_interpolation(&mut modules);
    modules.iter_mut().for_each(wrapped_main::inline);
    declared.samplers = places.samplers;
    declared.uniforms = places.uniforms;
    declared.numbers.append(&mut places.numbers);
    for names in [&mut declared.rows, &mut declared.copies] {
        names.sort();
        names.dedup();
    }
    beyond_wgsl::narrow_storage(&mut modules);
    Ok((modules, declared))
}

/// Refuses a module without a vertex or fragment stage.
fn check_stages(module: &dr::Module, name: &str) -> Result<(), Error> {
    let models = module.entry_points.iter().filter_map(prune::entry);
    let models: Vec<ExecutionModel> = models.map(|(model, _)| model).collect();
    match models.first() {
        _ if models.iter().any(|m| prune::is_of_material(*m)) => Ok(()),
        None => Err(Error::new(
            Code::NoEntryPoint,
            format!("{name} has no entry point"),
        )),
        Some(model) => Err(Error::new(
            Code::Foreign,
            format!("{name} is a module of the stage {model:?}, which preshade does not read"),
        )
        .note("give a vertex and a fragment stage")),
    }
}

fn model(stage: ShaderStage) -> Option<ExecutionModel> {
    match stage {
        ShaderStage::Vertex => Some(ExecutionModel::Vertex),
        ShaderStage::Fragment => Some(ExecutionModel::Fragment),
        _ => None,
    }
}

/// Maps instructions of a module to places in messages.
struct Text {
    /// Offset of the listing in the source map.
    base: u32,
    /// Offset of each of the author's files in the source map.
    files: Vec<Option<u32>>,
    listing: Listing,
    /// The author's variable for each variable that replaces one.
    became: HashMap<Word, Word>,
}

impl Text {
    /// The author's line for an instruction, or else its line in the listing.
    fn span(&self, instruction: usize) -> Option<Span> {
        let author = self.listing.author_line(instruction);
        let author = author.and_then(|(file, range)| Some(((*self.files.get(file)?)?, range)));
        let own = || Some((self.base, self.listing.line(instruction)?));
        let (base, range) = author.or_else(own)?;
        Some(Span::new(
            base + range.start as u32,
            base + range.end as u32,
        ))
    }

    fn of_result(&self, id: Word) -> Option<usize> {
        self.listing.results.get(&id).copied()
    }

    /// An error about an instruction.
    fn error(&self, code: Code, message: impl Into<String>, instruction: Option<usize>) -> Error {
        let error = Error::new(code, message);
        self.at(error, instruction)
    }

    /// Adds an instruction's place to an error, and also names the instruction, because the
    /// author's line may stand for several.
    fn at(&self, error: Error, instruction: Option<usize>) -> Error {
        let Some(instruction) = instruction else {
            return error;
        };
        let error = error.label_if(self.span(instruction));
        let line = self.listing.line(instruction);
        let line = line.and_then(|line| self.listing.text.get(line));
        match (
            self.listing.author_line(instruction),
            self.listing.author_place(instruction),
        ) {
            (Some(_), _) => {
                error.note(format!("the instruction is `{}`", line.unwrap_or_default()))
            }
            (None, Some(place)) => error.note(format!("it comes from {place}")),
            (None, None) => error,
        }
    }
}

/// Converts one module.
fn one(
    module: dr::Module,
    text: &mut Text,
    places: &mut Places,
    lengths: &constants::Lengths,
    declared: &mut Declared,
) -> Result<Module, Error> {
    let mut builder = Builder::new_from_module(module);
    declared.notes.extend(interface::drop_bases(&mut builder));
    if let Some(lack) = unsupported::find(builder.module_ref()) {
        let at = lack.line.map(|line| line as usize);
        let at = at.or_else(|| text.of_result(lack.id?));
        let error = unsupported::refuse(&lack);
        return Err(text.at(error, at));
    }
    blocks::drop_unreachable(&mut builder);
    exits::gather(&mut builder);
    blocks::drop_unreachable(&mut builder);
    switches::order(&mut builder);
    pointers::renew(&mut builder);
    declared.copies.extend(names::give(&mut builder));
    if text.listing.prints {
        let note = "`debugPrintf` is dropped: WebGPU prints nothing";
        declared.notes.push(note.to_owned());
    }
    if let Some((id, name)) = constants::not_finite(builder.module_ref()) {
        let message = format!("the default of the specialisation constant `{name}` is not finite");
        let error = text.error(Code::Unsupported, message, text.of_result(id));
        return Err(error.note("WGSL has no such literal: give it a finite default"));
    }
    constants::compute_infinite(&mut builder);
    interface::store_initial(&mut builder);
    constants::settle(&mut builder, lengths);
    interface::drop_memory_decorations(&mut builder);
    declared.point_size |= interface::split_per_vertex(&mut builder);
    if precise::keep(&mut builder) {
        declared
            .notes
            .push(naga_edit::declared::PRECISE_NOTE.to_owned());
    }
    varyings::open(&mut builder).map_err(|id| {
        let message = format!(
            "an input or output of more than {} parts is not supported",
            varyings::MOST_LEAVES
        );
        text.error(Code::Unsupported, message, text.of_result(id))
    })?;
    combined::part(&mut builder, places);
    combined::check(builder.module_ref()).map_err(|unfit| {
        let at = text.of_result(unfit.id);
        text.error(Code::Unsupported, unfit.why, at)
            .note(unfit.remedy)
    })?;
    text.became = combined::separate(&mut builder, places);
    let demotes = |i: &dr::Instruction| i.class.opcode == Op::DemoteToHelperInvocation;
    declared.demotes |= builder.module_ref().all_inst_iter().any(demotes);
    instructions::replace(&mut builder).map_err(|lost| {
        let message = format!(
            "naga, the parser preshade uses, does not read {}",
            lost.what
        );
        text.error(
            Code::Unsupported,
            message,
            lost.instruction.map(|n| n as usize),
        )
    })?;
    let rows = layout::fit(&mut builder).map_err(|unfit| {
        let at = unfit.line.map(|line| line as usize);
        let at = at.or_else(|| text.of_result(unfit.id));
        let message = format!("WGSL cannot express the layout of a block: {}", unfit.why);
        text.error(Code::Unsupported, message, at)
    })?;
    declared.rows.extend(rows);
    let mut words = builder.module();
    words.extensions.clear();
    words
        .annotations
        .retain(|i| i.class.opcode != Op::DecorateString);
    prune::drop_unused(&mut words);
    let sampled = interface::sampled(&words);
    let read = read(&words.assemble(), text)?;
    let mut module = settled(read, text);
    interface::sample(&mut module, &sampled);
    let stages: Vec<ShaderStage> = module.entry_points.iter().map(|e| e.stage).collect();
    for entry in &mut module.entry_points {
        // Both stages may use the name. If a stage has several entry points, the author selects by
        // this name.
        let is_only = stages.iter().filter(|s| **s == entry.stage).count() == 1;
        if is_only && entry.name == "main" {
            entry.name = format!("{}_main", naga_edit::interface::stage_name(entry.stage));
            declared.mains.push(entry.stage);
        }
        let name = names::identifier(&entry.name);
        if name != entry.name {
            let note = format!("the entry point {:?} is called `{name}`", entry.name);
            declared.notes.push(note);
            entry.name = name;
        }
    }
    Ok(module)
}

/// Normalises the module for the passes.
fn settled((mut module, places): (Module, Offsets), text: &Text) -> Module {
    binding_arrays::replace(&mut module);
    instructions::layers(&mut module);
    killed_loops::end(&mut module);
    instructions::demote(&mut module);
    parameters::settle(&mut module);
    loops::settle(&mut module);
    let to = |span: Span| {
        let at = span
            .to_range()
            .and_then(|range| places.instruction(range.start));
        at.and_then(|at| text.span(at)).unwrap_or(Span::UNDEFINED)
    };
    map_spans::map_spans(&mut module, &to);
    interface::name_outputs(&mut module);
    module
}

/// Instructions of the listing, by their byte offsets in the changed words.
struct Offsets(Vec<(usize, Option<usize>)>);

impl Offsets {
    /// The offsets in assembled words, by the lines that [`listing::read`] adds.
    fn of(words: &[u32], text: &Text) -> Self {
        let mut all = Vec::new();
        let mut at = 5;
        while let Some(word) = words.get(at) {
            let (op, length) = (word & 0xffff, (word >> 16) as usize);
            let operand = |n: usize| words.get(at + n).copied();
            if op == Op::Line as u32 {
                all.extend(operand(2).map(|line| (at * 4, Some(line as usize))));
            }
            // A type's result id is its first operand, that of another definition the second.
            let result = match op {
                _ if (Op::TypeVoid as u32..Op::ConstantTrue as u32).contains(&op) => operand(1),
                _ if (Op::ConstantTrue as u32..=Op::SpecConstantOp as u32).contains(&op) => {
                    operand(2)
                }
                // Other instructions without a line belong to the function.
                _ if op == Op::Variable as u32 || op == Op::Function as u32 => operand(2),
                _ => None,
            };
            if let Some(id) = result {
                let id = text.became.get(&id).copied().unwrap_or(id);
                all.push((at * 4, text.of_result(id)));
            }
            at += length.max(1);
        }
        Self(all)
    }

    fn instruction(&self, offset: usize) -> Option<usize> {
        let next = self.0.partition_point(|(at, _)| *at <= offset);
        self.0.get(next.checked_sub(1)?)?.1
    }
}

/// Parses words with naga.
fn read(words: &[u32], text: &Text) -> Result<(Module, Offsets), Error> {
    let options = spv::Options {
        adjust_coordinate_space: false,
        strict_capabilities: false,
        block_ctx_dump_prefix: None,
    };
    // The parser stops at the word with the error.
    let taken = Rc::new(Cell::new(0_usize));
    let counter = Rc::clone(&taken);
    let counted = words.iter().copied().inspect(move |_| {
        counter.set(counter.get() + 1);
    });
    let offsets = Offsets::of(words, text);
    match spv::Frontend::new(counted, &options).parse() {
        Ok(module) => Ok((module, offsets)),
        Err(error) => {
            let at = offsets.instruction(taken.get().saturating_sub(1) * 4);
            Err(text.error(code(&error), message(&error), at))
        }
    }
}

fn code(error: &spv::Error) -> Code {
    use spv::Error as E;
    match error {
        E::InvalidHeader
        | E::InvalidWordCount
        | E::IncompleteData
        | E::BadString
        | E::InvalidOperand
        | E::InvalidOperandCount(..)
        | E::InvalidTerminator
        | E::UnknownInstruction(_) => Code::Parse,
        _ => Code::Unsupported,
    }
}

/// The parser's message without naga's internal handles.
fn message(error: &spv::Error) -> String {
    use spv::Error as E;
    let what = match error {
        E::UnsupportedInstruction(_, op) => format!("`Op{op:?}`"),
        E::UnsupportedExtInst(n) => match rspirv::spirv::GlslStd450Op::from_u32(*n) {
            Some(function) => format!("the function {function:?} of GLSL.std.450"),
            None => format!("the extended instruction {n}"),
        },
        E::UnsupportedBuiltIn(n) => match rspirv::spirv::BuiltIn::from_u32(*n) {
            Some(built_in) => format!("the built-in {built_in:?}"),
            None => format!("the built-in {n}"),
        },
        E::UnsupportedExecutionMode(n) => match rspirv::spirv::ExecutionMode::from_u32(*n) {
            Some(mode) => format!("the execution mode {mode:?}"),
            None => format!("the execution mode {n}"),
        },
        E::UnsupportedImageFormat(n) => match rspirv::spirv::ImageFormat::from_u32(*n) {
            Some(format) => format!("the image format {format:?}"),
            None => format!("the image format {n}"),
        },
        E::InvalidStorageImageWithoutFormat => {
            "a storage image without a format (in HLSL give `[[vk::image_format(\"rgba8\")]]`)"
                .to_owned()
        }
        E::InconsistentComparisonSampling(_) => {
            "a texture that is sampled both with and without a comparison".to_owned()
        }
        E::NonBindingArrayOfImageOrSamplers => "an array of textures without a binding".to_owned(),
        other => {
            let text = other.to_string();
            let text = text.split(" [").next().unwrap_or(&text);
            return format!("naga, the parser preshade uses, rejects it: {text}");
        }
    };
    format!("naga, the parser preshade uses, does not read {what}")
}
