//! Our own WGSL of `half-rate`: the content of a texel, and how a pixel reads its neighbours.
//!
//! A texel stands for the pixel at twice its coordinates. So a pixel of even coordinates reads its
//! own value, and another one the mean of two or four neighbours: the bilinear weights are all
//! equal.
//!
//! The guides' weights have no unit and no parameter, because it is unknown whether a guide is a
//! depth, a normal or a colour. Each squared difference is divided by the mean over the four
//! neighbours: on a smooth surface all four come to 1, and across an edge some to 0 and others to 2
//! or more.
//!
//! A pixel is *alike* if in every guide it is no farther from some neighbour than the neighbours
//! are from each other. A thin object that fell between the neighbours is not.

use std::fmt::Write;

use super::Carried;
use super::values::words;

/// Names of our own functions.
pub(crate) const PIXEL: &str = "half_rate_pixel";
pub(crate) const STORE: &str = "half_rate_store";
pub(crate) const READ: &str = "half_rate_read";

/// Letters of a texel's words.
const LETTERS: [&str; 4] = ["x", "y", "z", "w"];

/// Names of a target's texture, in order.
pub(crate) const TEXTURES: [&str; 2] = ["half_rate_texels", "half_rate_texels_more"];

/// A guide's factor of a weight is `1 / (FLAT + r * r)`, where `r` is its squared difference over the mean
/// of the four: 14 times less across an edge between two and two.
const FLAT: &str = "0.3";

/// Squared difference of a guide, relative to its magnitude, that hardly matters.
const SLIGHT: &str = "0.01";

/// Names of the four neighbours.
const NEIGHBOURS: [&str; 4] = ["a", "b", "c", "d"];

/// The layout of a texel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Layout {
    /// Components of each value.
    pub values: Vec<u8>,
    /// Components of each guide.
    pub guides: Vec<u8>,
}

impl Layout {
    pub fn of(carried: &[Carried], guides: &[Carried]) -> Self {
        let widths = |of: &[Carried]| of.iter().map(|c| c.width).collect();
        Self {
            values: widths(carried),
            guides: widths(guides),
        }
    }

    pub fn targets(&self) -> usize {
        words(self.values.iter().sum(), self.guides.iter().copied()).div_ceil(4) as usize
    }

    /// The functions that the half-rate stage calls.
    pub fn storing(&self) -> String {
        let mut words: Vec<String> = Vec::new();
        for (i, width) in self.values.iter().enumerate() {
            words
                .extend(components(&format!("v{i}"), *width).map(|c| format!("bitcast<u32>({c})")));
        }
        // A cleared texel is a NaN, which no neighbour reads.
        words[0].insert(0, '~');
        let mut parts: Vec<String> = Vec::new();
        for (i, width) in self.guides.iter().enumerate() {
            match width {
                1 => words.push(format!("bitcast<u32>(g{i})")),
                _ => parts.extend(components(&format!("g{i}"), *width)),
            }
        }
        words.extend(parts.chunks(2).map(halves));
        words.resize(self.targets() * 4, "0u".to_owned());
        let targets: Vec<String> = words
            .chunks(4)
            .map(|w| format!("vec4<u32>({})", w.join(", ")))
            .collect();
        let (declared, result, returned) = match targets.as_slice() {
            [one] => (String::new(), "vec4<u32>", one.clone()),
            several => (
                "struct HalfRateTexels { @location(0) first: vec4<u32>, @location(1) more: \
                 vec4<u32> }\n"
                    .to_owned(),
                "HalfRateTexels",
                format!("HalfRateTexels({})", several.join(", ")),
            ),
        };
        let parameters = self.parameters(true).join(", ");
        format!(
            "{declared}fn {PIXEL}(at: vec4<f32>) -> vec4<f32> {{
    return vec4<f32>(floor(at.xy) * 2.0 + 0.5, at.zw);
}}
fn {STORE}({parameters}) -> {result} {{
    return {returned};
}}
"
        )
    }

    /// The functions that the main stage calls. The targets are bound in `group` from `first` on.
    /// `with_alike`: the result also has whether the pixel is like a neighbour.
    pub fn reading(&self, [group, first]: [u32; 2], with_alike: bool) -> String {
        let mut text = String::new();
        for (i, name) in TEXTURES.iter().enumerate().take(self.targets()) {
            let _ = writeln!(
                text,
                "@group({group}) @binding({}) var {name}: texture_2d<u32>;",
                first + i as u32
            );
        }
        self.texel(&mut text);
        self.read(&mut text, with_alike);
        text
    }

    fn parameters(&self, with_values: bool) -> Vec<String> {
        let of = |letter: char, widths: &[u8]| -> Vec<String> {
            let all = widths.iter().enumerate();
            all.map(|(i, width)| format!("{letter}{i}: {}", float(*width)))
                .collect()
        };
        let values = if with_values {
            of('v', &self.values)
        } else {
            Vec::new()
        };
        [values, of('g', &self.guides)].concat()
    }

    /// Loads and unpacks a texel.
    fn texel(&self, text: &mut String) {
        let members = [self.parameters(true), vec!["covered: f32".to_owned()]].concat();
        let _ = writeln!(text, "struct HalfRateTexel {{ {} }}", members.join(", "));
        let _ = writeln!(
            text,
            "fn half_rate_texel(at: vec2<i32>) -> HalfRateTexel {{"
        );
        for (i, name) in TEXTURES.iter().enumerate().take(self.targets()) {
            let _ = writeln!(text, "    let t{i} = textureLoad({name}, at, 0);");
        }
        let mut at = 0_usize;
        let mut next = || {
            let word = format!("t{}.{}", at / 4, LETTERS[at % 4]);
            at += 1;
            word
        };
        let mut finite = Vec::new();
        for (i, width) in self.values.iter().enumerate() {
            let bits: Vec<String> = (0..*width)
                .map(|c| match (i, c) {
                    (0, 0) => format!("~{}", next()),
                    _ => next(),
                })
                .collect();
            let floats: Vec<String> = bits.iter().map(|b| format!("bitcast<f32>({b})")).collect();
            finite.extend(
                bits.iter()
                    .map(|b| format!("({b} & 0x7f800000u) != 0x7f800000u")),
            );
            let ty = float(*width);
            let _ = writeln!(text, "    let v{i} = {ty}({});", floats.join(", "));
        }
        let scalars = self.guides.iter().enumerate().filter(|(_, w)| **w == 1);
        for (i, _) in scalars {
            let _ = writeln!(text, "    let g{i} = bitcast<f32>({});", next());
        }
        let vectors = || self.guides.iter().enumerate().filter(|(_, w)| **w > 1);
        let halves: usize = vectors().map(|(_, w)| usize::from(*w)).sum();
        for i in 0..halves.div_ceil(2) {
            let _ = writeln!(text, "    let h{i} = unpack2x16float({});", next());
        }
        let mut halves = (0..halves).map(|i| format!("h{}.{}", i / 2, LETTERS[i % 2]));
        for (i, width) in vectors() {
            let own: Vec<String> = halves.by_ref().take(usize::from(*width)).collect();
            let ty = float(*width);
            let _ = writeln!(text, "    let g{i} = {ty}({});", own.join(", "));
        }
        let _ = writeln!(text, "    let covered = {};", finite.join(" && "));
        let values: Vec<String> = (self.values.iter().enumerate())
            .map(|(i, width)| format!("select({}(), v{i}, covered)", float(*width)))
            .collect();
        let guides = (0..self.guides.len()).map(|i| format!("g{i}"));
        let all: Vec<String> = values.into_iter().chain(guides).collect();
        let _ = writeln!(
            text,
            "    return HalfRateTexel({}, select(0.0, 1.0, covered));\n}}",
            all.join(", ")
        );
    }

    /// Weighs the four neighbours of a pixel.
    fn read(&self, text: &mut String, with_alike: bool) {
        let mut members: Vec<String> = (self.values.iter().enumerate())
            .map(|(i, width)| format!("v{i}: {}", float(*width)))
            .collect();
        members.extend(with_alike.then(|| "alike: bool".to_owned()));
        let _ = writeln!(text, "struct HalfRateRead {{ {} }}", members.join(", "));
        let parameters = [vec!["at: vec4<f32>".to_owned()], self.parameters(false)].concat();
        let _ = writeln!(
            text,
            "fn {READ}({}) -> HalfRateRead {{
    let pixel = vec2<i32>(at.xy);
    let last = vec2<i32>(textureDimensions({})) - vec2<i32>(1);
    let low = min(pixel / vec2<i32>(2), last);
    let high = min((pixel + vec2<i32>(1)) / vec2<i32>(2), last);
    let a = half_rate_texel(low);
    let b = half_rate_texel(vec2<i32>(high.x, low.y));
    let c = half_rate_texel(vec2<i32>(low.x, high.y));
    let d = half_rate_texel(high);
    let given = vec4<f32>(a.covered, b.covered, c.covered, d.covered);
    var raised = given;",
            parameters.join(", "),
            TEXTURES[0]
        );
        if !self.guides.is_empty() {
            self.compare(text, with_alike);
        }
        let _ = writeln!(
            text,
            "    let weight = raised / max(dot(raised, vec4<f32>(1.0)), 1e-30);"
        );
        let mut results: Vec<String> = (0..self.values.len())
            .map(|i| {
                format!(
                    "a.v{i} * weight.x + b.v{i} * weight.y + c.v{i} * weight.z + d.v{i} * weight.w"
                )
            })
            .collect();
        results.extend(with_alike.then(|| match self.guides.is_empty() {
            true => "any(given > vec4<f32>())".to_owned(),
            false => "any(near)".to_owned(),
        }));
        let _ = writeln!(text, "    return HalfRateRead({});\n}}", results.join(", "));
    }

    /// The weights by the guides, and the neighbours that are like the pixel.
    fn compare(&self, text: &mut String, with_alike: bool) {
        let square = |of: &str, width: u8| match width {
            1 => format!("({of}) * ({of})"),
            _ => format!("dot({of}, {of})"),
        };
        let mut finite = Vec::new();
        for (i, width) in self.guides.iter().enumerate() {
            for t in NEIGHBOURS {
                let _ = writeln!(text, "    let away_{t}{i} = {t}.g{i} - g{i};");
            }
            let squares = NEIGHBOURS.map(|t| square(&format!("away_{t}{i}"), *width));
            let _ = writeln!(text, "    let raw{i} = vec4<f32>({});", squares.join(", "));
            finite.push(format!("raw{i}"));
        }
        // A guide that is not finite compares with nothing.
        let _ = writeln!(
            text,
            "    let is_covered = (given > vec4<f32>()) & ({} < vec4<f32>(1e30));
    let covered = select(vec4<f32>(), vec4<f32>(1.0), is_covered);
    let share = 1.0 / max(dot(covered, vec4<f32>(1.0)), 1.0);
    var unlike = vec4<f32>(1.0);",
            finite.join(" + ")
        );
        if with_alike {
            let _ = writeln!(text, "    var near = is_covered;");
        }
        for (i, width) in self.guides.iter().enumerate() {
            let _ = writeln!(
                text,
                "    let far{i} = select(vec4<f32>(), raw{i}, is_covered);
    let least{i} = {SLIGHT} * {} + 1e-30;
    let ratio{i} = far{i} / (dot(far{i}, vec4<f32>(share)) + least{i});
    unlike *= {FLAT} + ratio{i} * ratio{i};",
                match width {
                    // For a depth near 1, the distance from 1 measures how far away it is.
                    1 => format!("min(g{i} * g{i}, (1.0 - g{i}) * (1.0 - g{i}))"),
                    _ => square(&format!("g{i}"), *width),
                },
            );
            if with_alike {
                // A neighbour that is not covered does not count.
                let [a, b, c, d] = [("a", "x"), ("b", "y"), ("c", "z"), ("d", "w")]
                    .map(|(t, at)| format!("select(g{i}, {t}.g{i}, is_covered.{at})"));
                let of = |f: &str| format!("{f}({f}({a}, {b}), {f}({c}, {d}))");
                let _ = writeln!(
                    text,
                    "    let span{i} = {} - {};
    near = near & (far{i} <= vec4<f32>({} + least{i}));",
                    of("max"),
                    of("min"),
                    square(&format!("span{i}"), *width),
                );
            }
        }
        // A pixel whose own guide is not finite takes the mean.
        let _ = writeln!(
            text,
            "    raised = select(given, covered / unlike, any(is_covered));"
        );
    }
}

/// The type of this many floats.
fn float(width: u8) -> String {
    match width {
        1 => "f32".to_owned(),
        w => format!("vec{w}<f32>"),
    }
}

fn components(name: &str, width: u8) -> impl Iterator<Item = String> {
    (0..usize::from(width)).map(move |i| match width {
        1 => name.to_owned(),
        _ => format!("{name}.{}", LETTERS[i]),
    })
}

/// One or two numbers as a word. A number beyond a half's has no halves that WGSL names.
fn halves(of: &[String]) -> String {
    let second = of.get(1).map_or("0.0", String::as_str);
    format!(
        "pack2x16float(clamp(vec2<f32>({}, {second}), vec2<f32>(-65504.0), vec2<f32>(65504.0)))",
        of[0]
    )
}
