//! The parameters of a pass, read from their JSON schema, for listings and for error messages.

use preshade_plan::pass::AnyPass;
use serde::Serialize;
use serde_json::Value;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Name, as in `--pass PASS:NAME=VALUE`.
    pub name: String,
    pub what: String,
    /// Type, unless it is a choice: `number`, `integer` and so on.
    #[serde(rename = "type", skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// The allowed numbers, if they are bounded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<Range>,
    /// The allowed words, if it is a choice.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub choices: Vec<Choice>,
    /// `None`: the pass derives it, as the description explains.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub default: Option<Value>,
    /// Whether it is for tests and unusual devices alone. Recipes accept it, and listings only
    /// mention it. Its schema has `x-expert`.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub expert: bool,
}

impl Parameter {
    /// Its name and the words that it may be, without descriptions.
    pub fn in_short(&self) -> String {
        let words = self.choices.iter().map(|c| format!("`{}`", c.value));
        let words: Vec<String> = words.collect();
        match words.is_empty() {
            true => format!("`{}`", self.name),
            false => format!("`{}` ({})", self.name, words.join(", ")),
        }
    }
}

/// The allowed numbers of a parameter, from its JSON schema.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Range {
    /// Inclusive.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub minimum: Option<f64>,
    #[serde(rename = "exclusiveMinimum", skip_serializing_if = "Option::is_none")]
    pub above: Option<f64>,
    /// Inclusive.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub maximum: Option<f64>,
}

impl Range {
    fn of(property: &Value) -> Option<Self> {
        let bound = |key: &str| property.get(key).and_then(Value::as_f64);
        let range = Self {
            minimum: bound("minimum"),
            above: bound("exclusiveMinimum"),
            maximum: bound("maximum"),
        };
        (range != Self::default()).then_some(range)
    }

    /// Whether a number is allowed. NaN never is.
    pub fn contains(&self, value: f64) -> bool {
        !value.is_nan()
            && self.minimum.is_none_or(|m| value >= m)
            && self.above.is_none_or(|m| value > m)
            && self.maximum.is_none_or(|m| value <= m)
    }
}

impl std::fmt::Display for Range {
    /// In words, `above 0 and at most 1`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let bounds = [
            ("at least", self.minimum),
            ("above", self.above),
            ("at most", self.maximum),
        ];
        let words: Vec<String> = bounds
            .iter()
            .filter_map(|(word, bound)| Some(format!("{word} {}", (*bound)?)))
            .collect();
        f.write_str(&words.join(" and "))
    }
}

/// One word a parameter may be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Choice {
    pub value: String,
    pub what: String,
}

/// The parameters of `pass`, by name.
pub fn parameters(pass: &dyn AnyPass) -> Vec<Parameter> {
    let schema = pass.schema();
    let Some(properties) = schema.get("properties").and_then(Value::as_object) else {
        return Vec::new();
    };
    properties
        .iter()
        .map(|(name, property)| Parameter {
            name: name.clone(),
            what: description(property),
            kind: kind(property),
            range: Range::of(property),
            choices: choices(&schema, property),
            default: property.get("default").filter(|d| !d.is_null()).cloned(),
            expert: property.get("x-expert").is_some(),
        })
        .collect()
}

fn description(node: &Value) -> String {
    let text = node.get("description").and_then(Value::as_str);
    text.unwrap_or_default().replace('\n', " ")
}

/// The type of a property, ignoring `null` for a property that is not given.
fn kind(property: &Value) -> Option<String> {
    match property.get("type")? {
        Value::String(one) => Some(one.clone()),
        Value::Array(several) => several
            .iter()
            .filter_map(Value::as_str)
            .find(|t| *t != "null")
            .map(str::to_owned),
        _ => None,
    }
}

/// The words of an enumeration. Follows references and the `anyOf` of optional properties.
fn choices(schema: &Value, node: &Value) -> Vec<Choice> {
    if let Some(target) = node
        .get("$ref")
        .and_then(Value::as_str)
        .and_then(|r| schema.pointer(r.trim_start_matches('#')))
    {
        return choices(schema, target);
    }
    let word = |value: &Value, what: String| {
        value.as_str().map(|v| Choice {
            value: v.to_owned(),
            what,
        })
    };
    if let Some(value) = node.get("const") {
        return word(value, description(node)).into_iter().collect();
    }
    let mut found = Vec::new();
    for value in array(node, "enum") {
        found.extend(word(value, String::new()));
    }
    for key in ["oneOf", "anyOf", "allOf"] {
        for part in array(node, key) {
            found.extend(choices(schema, part));
        }
    }
    found
}

fn array<'a>(node: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    node.get(key)
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
}
