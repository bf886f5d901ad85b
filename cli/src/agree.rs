//! `preshade agree`: compares two programs, whoever wrote them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use preshade_compiler::command::agree::{
    Compared, Cost, FailOn, Side, breaks, compare, parse_class,
};
use preshade_compiler::command::agree_text::{Pair, Report};
use preshade_compiler::recipe::Recipe;
use preshade_lab::measure::Beside;
use preshade_plan::mapping::Equation;
use preshade_plan::plan::Plan;
use preshade_validate::Effort;
use preshade_validate::agree::{self, Agreement, Question, Relation};
use rayon::prelude::*;

use crate::agree_inputs::{self, Asked};
use crate::agree_revisions::{self, Tree};
use crate::agree_scene::SceneArgs;
use crate::file_names::is_stdin;
use crate::input::{Clip, ShaderArgs};
use crate::{Ending, Failure, output};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade agree pbr.wgsl --with depth.wgsl --as prepass
  preshade agree lit.wgsl --with lit.shadow.wgsl --as shadow --map light.view_proj=camera.view_proj
  preshade agree lit.vert lit.frag --with shadow.vert,shadow.frag --as shadow
  preshade agree HEAD~1:shaders HEAD:shaders --as same             did this change the picture?
  preshade agree old/lit.wgsl new/lit.wgsl --as same --format markdown
  preshade agree shaders --pairs agree.toml --fail-on positions,keeps-hidden
  preshade agree lit.wgsl --with depth.wgsl --as prepass --scene scene.toml --out pictures

Bindings are matched by group and number, then by name and type, then by --map; attributes by
location, then by name. Where number and name disagree, --as same takes the number if both programs
are of one language; otherwise the name decides. Exit status: 0 the two agree, 1 they don't, 2 bad usage or input, 3 a
part of what was asked could not be evaluated.")]
pub struct AgreeArgs {
    /// The files of the other program, separated by commas: one file with both entry points, or a
    /// vertex and a fragment file.
    #[arg(long, value_name = "FILE[,FILE]", value_delimiter = ',', num_args = 1)]
    with: Vec<PathBuf>,
    /// What the two should have in common.
    #[arg(long = "as", value_name = "RELATION", value_parser = relations())]
    relation: Option<Relation>,
    /// A variable, member or attribute of the other program, and the one of the first that it holds;
    /// may be given several times. One of them may be a product of matrices: `light_space=proj*view`.
    #[arg(long, value_name = "THEIRS=OURS", value_parser = parse_map)]
    map: Vec<Equation>,
    /// With `--as normal`, the value of the first program's fragment stage that is the normal, as in
    /// the pass `outputs`. Default: its output with `normal` in its name, or the unit vector that
    /// meets a light in a dot product.
    #[arg(long, value_name = "NAME")]
    normal: Option<String>,
    /// A TOML file of pairs, each with `first`, `second` and `as`. Their paths are below FILE, a
    /// folder.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["with", "map", "normal"])]
    pairs: Option<PathBuf>,
    /// A TOML file of findings to accept, each with `pair`, `class` and `reason`.
    #[arg(long, value_name = "FILE")]
    waivers: Option<PathBuf>,
    /// The findings that make the exit status 1, separated by commas, or all, or none. Default: all
    /// except view-dependent, extreme, and rounding where only `same` and `prepass` mind it.
    #[arg(long, value_name = "CLASS,..", value_delimiter = ',', value_parser = parse_class)]
    fail_on: Option<Vec<FailOn>>,
    /// Inputs to try for each promise without a proof.
    #[arg(long, value_name = "N", default_value_t = INPUTS, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    inputs: u64,
    /// Print partners, and the inputs of each finding.
    #[arg(short, long)]
    verbose: bool,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Form::Human)]
    format: Form,
    /// Vertex entry point of the other program, if it has several.
    #[arg(long, value_name = "NAME")]
    with_vertex: Option<String>,
    /// Fragment entry point of the other program, if it has several.
    #[arg(long, value_name = "NAME")]
    with_fragment: Option<String>,
    /// Define a macro for the other program instead of those of --define; may be given several times.
    #[arg(long, value_name = "NAME[=VALUE]")]
    with_define: Vec<String>,
    #[command(flatten)]
    drawing: SceneArgs,
    // Last: its help heading applies to the flags after it.
    #[command(flatten)]
    pub shader: ShaderArgs,
}

/// Inputs of a promise, by default.
const INPUTS: u64 = 480;

/// Output form.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Form {
    /// For people.
    Human,
    /// For programs.
    Json,
    /// For a comment on a pull request.
    Markdown,
}

/// Reads a relation, with its meaning in the help.
fn relations() -> impl TypedValueParser<Value = Relation> {
    let known = Relation::ALL.map(|r| PossibleValue::new(r.name()).help(r.meaning()));
    PossibleValuesParser::new(known).try_map(|name| {
        let found = Relation::ALL.into_iter().find(|r| r.name() == name);
        found.ok_or_else(|| format!("there is no relation `{name}`"))
    })
}

fn parse_map(text: &str) -> Result<Equation, String> {
    text.parse().map_err(|e| format!("{e}"))
}

impl AgreeArgs {
    /// The arguments that read the other program.
    fn other(&self, files: Vec<PathBuf>) -> ShaderArgs {
        let mut other = ShaderArgs {
            files,
            vertex: self.with_vertex.clone(),
            fragment: self.with_fragment.clone(),
            ..self.shader.clone()
        };
        if !self.with_define.is_empty() {
            other.glsl.define.clone_from(&self.with_define);
        }
        other
    }

    fn relation(&self) -> Result<Relation, Failure> {
        self.relation.ok_or_else(|| {
            let names: Vec<&str> = Relation::ALL.iter().map(|r| r.name()).collect();
            Failure(format!(
                "error: --as says what the two should have in common: {}",
                names.join(", ")
            ))
        })
    }

    fn asked(&self) -> Result<Everything, Failure> {
        if self
            .shader
            .files
            .iter()
            .chain(&self.with)
            .any(|f| is_stdin(f))
        {
            return Err(Failure("error: agree reads files, not stdin".to_owned()));
        }
        let of_pairs = |pairs| Everything {
            pairs,
            ..Everything::default()
        };
        if let Some(file) = &self.pairs {
            let [folder] = &self.shader.files[..] else {
                return Err(Failure(
                    "error: with --pairs, FILE is the folder of the shaders".to_owned(),
                ));
            };
            let tree = Tree::open(folder)?;
            return Ok(Everything {
                pairs: agree_inputs::read(file, tree.path(), &self.shader)?,
                trees: vec![tree],
                ..Everything::default()
            });
        }
        let relation = self.relation()?;
        if self.normal.is_some() && relation != Relation::Normal {
            return Err(Failure("error: --normal is for `--as normal`".to_owned()));
        }
        let pair = |first: ShaderArgs, second: ShaderArgs| Asked {
            name: None,
            first,
            second,
            relation,
            maps: self.map.clone(),
            normal: self.normal.clone(),
        };
        match (&self.shader.files[..], &self.with[..]) {
            (ours, with @ [_, ..]) => {
                if let Some(folder) = ours.iter().chain(with).find(|f| f.is_dir()) {
                    return Err(Failure(format!(
                        "error: {} is a folder\n = --with is for one program; `preshade agree FIRST \
                         SECOND` takes two folders",
                        folder.display()
                    )));
                }
                let first = self.shader.clone();
                Ok(of_pairs(vec![pair(first, self.other(self.with.clone()))]))
            }
            ([before, after], []) => {
                let (before, after) = (Tree::open(before)?, Tree::open(after)?);
                if before.is_folder() != after.is_folder() {
                    return Err(Failure(format!(
                        "error: {} and {} are a folder and a file",
                        before.name(),
                        after.name()
                    )));
                }
                let (pairs, alone) = agree_revisions::pairs(
                    [&before, &after],
                    [&self.shader, &self.other(Vec::new())],
                    &pair,
                )?;
                Ok(Everything {
                    pairs,
                    alone,
                    trees: vec![before, after],
                })
            }
            _ => Err(Failure(
                "error: agree needs two programs: FIRST --with SECOND, or two files, folders or \
                 REVISION:PATH"
                    .to_owned(),
            )),
        }
    }
}

pub fn run(args: &AgreeArgs) -> Result<Ending, Failure> {
    let waivers = match &args.waivers {
        Some(path) => agree_inputs::waivers(path)?,
        None => match &args.pairs {
            Some(path) => agree_inputs::waivers_beside(path)?,
            None => Vec::new(),
        },
    };
    args.drawing.check()?;
    let Everything {
        pairs: asked,
        alone,
        trees,
    } = args.asked()?;
    let named = |text: &str| {
        trees
            .iter()
            .fold(text.to_owned(), |text, tree| tree.renamed(&text))
    };
    let is_one = asked.len() == 1 && (args.pairs.is_some() || trees.iter().all(|t| !t.is_folder()));
    if args.drawing.scene.is_some() && !is_one {
        return Err(Failure("error: --scene is for one pair".to_owned()));
    }
    let compare = || -> Vec<Result<Checked, Failure>> {
        let pairs = asked.par_iter();
        pairs
            .map(|asked| checked(args, asked, is_one, &named))
            .collect()
    };
    let results = output::working(
        format!("comparing {}", output::count(asked.len(), "pair")),
        compare,
    );
    let mut report = Report::default();
    report.alone = alone;
    let mut names = BTreeMap::new();
    for (asked, result) in asked.iter().zip(results) {
        names.insert(named(&asked.name()), result.is_ok());
        match result {
            Ok(Checked::Compared(pair)) => report.pairs.push(*pair),
            Ok(Checked::Unchanged) => report.unchanged += 1,
            Ok(Checked::NoMaterial) => report.left_out += 1,
            Err(Failure(why)) => report.errors.push(named(&why)),
        }
    }
    report.waive(&waivers, &names, |class, relation| {
        breaks(args.fail_on.as_deref(), class, relation)
    });
    match args.format {
        // Nothing but errors.
        Form::Human | Form::Markdown if report.pairs.is_empty() && report.unchanged == 0 => {}
        Form::Human => output::table(&report.human(args.verbose))?,
        Form::Markdown => output::table(&report.markdown())?,
        Form::Json => output::json(&report)?,
    }
    if !report.errors.is_empty() {
        return Err(Failure(report.errors.join("\n")));
    }
    Ok(match () {
        () if report.is_broken() => Ending::ContractBroken,
        () if report.is_partial() => Ending::NotMeasured,
        () => Ending::Fine,
    })
}

#[derive(Default)]
struct Everything {
    pairs: Vec<Asked>,
    /// Sentences on materials that are in one folder alone.
    alone: Vec<String>,
    /// The trees that the pairs are in.
    trees: Vec<Tree>,
}

/// The result of a pair.
enum Checked {
    Compared(Box<Pair<Beside>>),
    /// Two folders have the same text, imports included.
    Unchanged,
    /// Its files are no material, in a folder.
    NoMaterial,
}

/// Whether two plans are of one text.
fn are_one_text(first: &Plan, second: &Plan) -> bool {
    let texts = |plan: &Plan| {
        let files = plan.main().and_then(|p| plan.program(p));
        let files = files.map(|p| p.sources().files().iter().map(|f| f.text.clone()));
        files.map(Iterator::collect::<Vec<_>>)
    };
    texts(first) == texts(second)
}

fn checked(
    args: &AgreeArgs,
    asked: &Asked,
    is_one: bool,
    named: &dyn Fn(&str) -> String,
) -> Result<Checked, Failure> {
    let is_of_folders = !is_one && args.pairs.is_none();
    if is_of_folders && asked.first.is_no_material() && asked.second.is_no_material() {
        return Ok(Checked::NoMaterial);
    }
    let [first, second] = [plan(&asked.first)?, plan(&asked.second)?];
    if is_of_folders && asked.relation == Relation::Same && are_one_text(&first, &second) {
        return Ok(Checked::Unchanged);
    }
    let effort = Effort {
        inputs: args.inputs,
        ..Effort::default()
    };
    let name = named(&asked.name());
    let question = Question {
        relation: asked.relation,
        maps: &asked.maps,
        normal: asked.normal.as_deref(),
    };
    let told = |e: agree::Mismatch| {
        let files = |s: &ShaderArgs| named(&files(&s.files));
        Failure(format!(
            "error: {e}\n = the first is {}, the second {}",
            files(&asked.first),
            files(&asked.second)
        ))
    };
    let mut sides = [asked.first.clone(), asked.second.clone()];
    let is_given = sides.each_ref().map(|side| side.glsl.clip.is_some());
    let again = |side: usize| -> Result<Side, Failure> {
        let mut as_written = sides[side].clone();
        as_written.glsl.clip = Some(Clip::ZeroToOne);
        Ok(Side {
            plan: plan(&as_written)?,
            name: named(&files(&as_written.files)),
        })
    };
    let Compared {
        agreement,
        plans,
        notes,
        as_written,
    } = compare([first, second], question, &effort, is_given, &again, &told)?;
    if let Some(side) = as_written {
        sides[side].glsl.clip = Some(Clip::ZeroToOne);
    }
    let [first, second] = &plans;
    let partners = &agreement.partners;
    let drawn = args
        .drawing
        .drawn(sides.each_ref(), [first, second], asked.relation, partners)?;
    let agreement = named_spots(agreement, named);
    let cost = [Cost::of(first), Cost::of(second)];
    Ok(Checked::Compared(Box::new(Pair::new(
        name, agreement, notes, cost, drawn,
    ))))
}

/// The agreement with the names of files as the user gave them.
fn named_spots(mut agreement: Agreement, named: &dyn Fn(&str) -> String) -> Agreement {
    for finding in &mut agreement.findings {
        let spots = [
            &mut finding.first,
            &mut finding.second,
            &mut finding.first_decides,
            &mut finding.second_decides,
        ];
        let places = spots
            .into_iter()
            .flatten()
            .filter_map(|s| s.location.as_mut());
        places.for_each(|place| place.file = named(&place.file));
    }
    agreement
}

/// The plan of a side as its author wrote it.
fn plan(shader: &ShaderArgs) -> Result<Plan, Failure> {
    if shader.is_scene() {
        return Err(Failure(
            "error: agree takes shaders: a scene's materials name theirs".to_owned(),
        ));
    }
    let none = Recipe { steps: Vec::new() };
    // Adds the files to a message that does not name one.
    let of_which = |Failure(why)| match shader
        .files
        .iter()
        .any(|f| why.contains(&files(std::slice::from_ref(f))))
    {
        true => Failure(why),
        false => Failure(format!(
            "{}\n = in {}",
            why.trim_end(),
            files(&shader.files)
        )),
    };
    let materials = shader.plans(&none).map_err(of_which)?;
    let plan = materials.asked.into_iter().next();
    plan.ok_or_else(|| Failure("error: there is no material".to_owned()))
}

/// The files of a side, as one word.
pub fn files(files: &[PathBuf]) -> String {
    let names: Vec<String> = files.iter().map(|f| f.display().to_string()).collect();
    names.join(",")
}

impl AgreeArgs {
    /// The files that it reads.
    pub fn reads(&self) -> Vec<PathBuf> {
        let files = self.shader.files.iter().chain(&self.with);
        let files = files.chain(&self.pairs).chain(&self.waivers);
        files.filter(|f| Path::new(f).exists()).cloned().collect()
    }
}
