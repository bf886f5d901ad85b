//! Reads a SPIR-V module and lists it as text, one instruction per line. Messages refer to this
//! text, or to the author's text if the module has debug information.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::ops::Range;

use rspirv::binary::{Consumer, Disassemble, ParseAction, Parser};
use rspirv::dr::{Instruction, Loader, Module, ModuleHeader, Operand};
use rspirv::spirv::Op;

use super::order;
use crate::words::to_bytes;
use shader_text::panics;

/// A place in the author's text.
#[derive(Clone, Copy, Debug)]
pub(super) struct TextPosition {
    /// Index into [`Listing::files`].
    file: usize,
    /// From 1.
    line: u32,
    /// From 1; 0 if unknown.
    column: u32,
}

/// A file that debug information names.
#[derive(Clone, Debug, Default)]
pub(super) struct File {
    pub name: String,
    /// The file's text. Empty if the module does not embed it.
    pub text: String,
}

/// A module as text, and where its instructions come from.
#[derive(Debug, Default)]
pub(crate) struct Listing {
    pub text: String,
    /// Byte range of each instruction's line.
    lines: Vec<Range<usize>>,
    /// Place of each instruction in the author's text.
    places: Vec<Option<TextPosition>>,
    pub(super) files: Vec<File>,
    /// Index of the instruction that defines each id.
    pub(super) results: HashMap<u32, usize>,
    /// Whether the module calls `NonSemantic.DebugPrintf`.
    pub(super) prints: bool,
}

impl Listing {
    /// Byte range of an instruction's line.
    pub(super) fn line(&self, instruction: usize) -> Option<Range<usize>> {
        self.lines.get(instruction).cloned()
    }

    /// File, and byte range of the author's line, for an instruction.
    pub(super) fn author_line(&self, instruction: usize) -> Option<(usize, Range<usize>)> {
        let place = (*self.places.get(instruction)?)?;
        let text = &self.files.get(place.file)?.text;
        let mut start = 0;
        let mut lines = text.split_inclusive('\n');
        for line in lines.by_ref().take(place.line.checked_sub(1)? as usize) {
            start += line.len();
        }
        let line = lines.next()?.trim_end();
        let indent = line.len() - line.trim_start().len();
        let column = (place.column.saturating_sub(1) as usize).max(indent);
        let from = match line.is_char_boundary(column) && column < line.len() {
            true => column,
            false => indent,
        };
        Some((place.file, start + from..start + line.len()))
    }

    /// File name and line in the author's text for an instruction.
    pub(super) fn author_place(&self, instruction: usize) -> Option<String> {
        let place = (*self.places.get(instruction)?)?;
        let file = self.files.get(place.file)?;
        Some(format!("{}:{}", file.name, place.line))
    }
}

/// Reads `words`. The module gets an `OpLine` before each instruction of a block, whose line is the
/// instruction's index in the listing. Transforms keep it there. Debug information is left out. An
/// error comes with the listing up to it.
pub(crate) fn read(words: &[u32]) -> (Listing, Result<Module, String>) {
    let mut reader = Reader::default();
    let bytes = to_bytes(words);
    // rspirv panics on an unterminated string.
    let parsed = panics::caught(|| Parser::new(&bytes, &mut reader).parse());
    let result = match parsed {
        Ok(parsed) => parsed.map_err(|e| e.to_string()),
        Err(_) => Err("an instruction is longer than the module".to_owned()),
    };
    for file in &mut reader.listing.files {
        // glslang puts its options above the author's text.
        if file.text.starts_with("// OpModuleProcessed")
            && let Some((_, own)) = file.text.split_once("\n#line 1\n")
        {
            file.text = own.to_owned();
        }
    }
    let module = std::mem::take(&mut reader.loader).module();
    let result = result.and_then(|()| order::check(&module));
    (reader.listing, result.map(|()| module))
}

#[derive(Default)]
struct Reader {
    loader: Loader,
    listing: Listing,
    in_block: bool,
    names: HashMap<u32, String>,
    strings: HashMap<u32, String>,
    /// `OpConstant`s of 32 bits. Debug lines refer to them.
    numbers: HashMap<u32, u32>,
    /// Index by the id of the file's name or of its `DebugSource`.
    files: HashMap<u32, usize>,
    last_file: Option<usize>,
    debug_set: Option<u32>,
    other_sets: Vec<u32>,
    place: Option<TextPosition>,
}

/// Instructions of `NonSemantic.Shader.DebugInfo.100`.
const DEBUG_SOURCE: u32 = 35;
const DEBUG_SOURCE_CONTINUED: u32 = 102;
const DEBUG_LINE: u32 = 103;
const DEBUG_NO_LINE: u32 = 104;

impl Reader {
    fn string(&self, operand: Option<&Operand>) -> Option<String> {
        self.strings.get(&operand?.id_ref_any()?).cloned()
    }

    fn add_file(&mut self, id: u32, name: String, text: Option<String>) {
        let files = &mut self.listing.files;
        let known = files.iter().position(|f| f.name == name);
        let index = known.unwrap_or_else(|| {
            files.push(File {
                name,
                text: String::new(),
            });
            files.len() - 1
        });
        if let Some(text) = text {
            files[index].text = text;
        }
        self.files.insert(id, index);
        self.last_file = Some(index);
    }

    fn continue_file(&mut self, more: Option<String>) {
        if let (Some(file), Some(more)) = (self.last_file, more) {
            self.listing.files[file].text += &more;
        }
    }

    /// Reads an instruction's debug information. Returns whether the instruction has no other
    /// purpose.
    fn learn(&mut self, instruction: &Instruction) -> bool {
        let id = |i: usize| instruction.operands.get(i).and_then(Operand::id_ref_any);
        let literal = |i: usize| match instruction.operands.get(i) {
            Some(Operand::LiteralString(text)) => Some(text.clone()),
            _ => None,
        };
        let number = |i: usize| match instruction.operands.get(i) {
            Some(Operand::LiteralBit32(n)) => Some(*n),
            _ => None,
        };
        match instruction.class.opcode {
            Op::Name => {
                let name = literal(1).filter(|name| !name.is_empty());
                // An empty name does not count.
                let Some(name) = name else { return true };
                if let Some(id) = id(0) {
                    self.names.insert(id, name);
                }
                false
            }
            Op::String => {
                if let (Some(id), Some(text)) = (instruction.result_id, literal(0)) {
                    self.strings.insert(id, text);
                }
                true
            }
            Op::Source => {
                if let Some((id, name)) = id(2).and_then(|id| Some((id, self.strings.get(&id)?))) {
                    let name = name.clone();
                    self.add_file(id, name, literal(3));
                }
                true
            }
            Op::SourceContinued => {
                self.continue_file(literal(0));
                true
            }
            Op::SourceExtension | Op::ModuleProcessed => true,
            Op::Line => {
                let name = self.string(instruction.operands.first());
                if let (Some(id), Some(name)) = (id(0), name) {
                    if !self.files.contains_key(&id) {
                        self.add_file(id, name, None);
                    }
                    self.place = Some(TextPosition {
                        file: self.files[&id],
                        line: number(1).unwrap_or(0),
                        column: number(2).unwrap_or(0),
                    });
                }
                true
            }
            Op::NoLine => {
                self.place = None;
                true
            }
            Op::Constant => {
                if let (Some(id), Some(n)) = (instruction.result_id, number(0)) {
                    self.numbers.insert(id, n);
                }
                false
            }
            Op::Extension => literal(0).is_some_and(|name| name == "SPV_KHR_non_semantic_info"),
            Op::ExtInstImport => {
                let name = literal(0).unwrap_or_default();
                let Some(set) = name.strip_prefix("NonSemantic.") else {
                    return false;
                };
                match set {
                    "Shader.DebugInfo.100" => self.debug_set = instruction.result_id,
                    _ => self.other_sets.extend(instruction.result_id),
                }
                self.listing.prints |= set == "DebugPrintf";
                true
            }
            Op::ExtInst if id(0).is_some() && id(0) == self.debug_set => {
                let instruction_number = match instruction.operands.get(1) {
                    Some(Operand::LiteralExtInstInteger(n)) => *n,
                    _ => 0,
                };
                let number = |i: usize| self.numbers.get(&id(i)?).copied();
                match instruction_number {
                    DEBUG_SOURCE => {
                        let name = self.string(instruction.operands.get(2));
                        let text = self.string(instruction.operands.get(3));
                        if let (Some(id), Some(name)) = (instruction.result_id, name) {
                            self.add_file(id, name, text);
                        }
                    }
                    DEBUG_SOURCE_CONTINUED => {
                        let more = self.string(instruction.operands.get(2));
                        self.continue_file(more);
                    }
                    DEBUG_LINE => {
                        let file = id(2).and_then(|id| self.files.get(&id));
                        self.place = file.map(|file| TextPosition {
                            file: *file,
                            line: number(3).unwrap_or(0),
                            column: number(5).unwrap_or(0),
                        });
                    }
                    DEBUG_NO_LINE => self.place = None,
                    _ => {}
                }
                true
            }
            Op::ExtInst => id(0).is_some_and(|id| self.other_sets.contains(&id)),
            _ => false,
        }
    }

    fn list(&mut self, instruction: &Instruction) {
        let listing = &mut self.listing;
        let start = listing.text.len();
        // rspirv separates a result type by two spaces.
        listing.text += &instruction.disassemble().replacen("  ", " ", 2);
        let end = listing.text.len();
        let own = instruction.operands.iter().filter_map(Operand::id_ref_any);
        let ids = instruction.result_id.into_iter().chain(own);
        let mut before = " ; ";
        let mut named: Vec<u32> = Vec::new();
        for id in ids.filter(|_| instruction.class.opcode != Op::Name) {
            if let Some(name) = self.names.get(&id)
                && !named.contains(&id)
            {
                named.push(id);
                let _ = write!(listing.text, "{before}%{id} is {name}");
                before = ", ";
            }
        }
        listing.text.push('\n');
        if let Some(id) = instruction.result_id {
            listing.results.insert(id, listing.lines.len());
        }
        listing.lines.push(start..end);
        listing.places.push(self.place);
    }
}

impl Consumer for Reader {
    fn initialize(&mut self) -> ParseAction {
        self.loader.initialize()
    }

    fn finalize(&mut self) -> ParseAction {
        self.loader.finalize()
    }

    fn consume_header(&mut self, module: ModuleHeader) -> ParseAction {
        self.loader.consume_header(module)
    }

    fn consume_instruction(&mut self, instruction: Instruction) -> ParseAction {
        let is_debug = self.learn(&instruction);
        let index = self.listing.lines.len();
        self.list(&instruction);
        if is_debug {
            return ParseAction::Continue;
        }
        let opcode = instruction.class.opcode;
        if self.in_block {
            let operands = [0, index as u32, 0].map(Operand::LiteralBit32).to_vec();
            let mut line = Instruction::new(Op::Line, None, None, operands);
            line.operands[0] = Operand::IdRef(0);
            if let error @ ParseAction::Error(_) = self.loader.consume_instruction(line) {
                return error;
            }
        }
        self.in_block = match opcode {
            Op::Label => true,
            _ if rspirv::grammar::reflect::is_block_terminator(opcode) => false,
            _ => self.in_block,
        };
        self.loader.consume_instruction(instruction)
    }
}
