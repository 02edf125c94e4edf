//! Configuration files: TOML in, checked configuration out, or one message that names the file, the
//! place, the finding and the remedy.

use alula_parameters::{ParameterError, Parameters};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Why a configuration was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// The text is not TOML, has an unknown key or a value of the wrong type.
    #[error("{file}: {message}")]
    Format {
        /// Where the text came from.
        file: String,
        /// Place, finding and remedy.
        message: String,
    },
    /// A value is outside what its declaration allows.
    #[error("{file}{place}: {error}")]
    Value {
        /// Where the text came from.
        file: String,
        /// `:line` of the key, or nothing where it is not in the text.
        place: String,
        /// Key, value and what is allowed.
        error: ParameterError,
    },
    /// A `key=value` override cannot be applied.
    #[error("--set {argument}: {reason}")]
    Override {
        /// The override as given.
        argument: String,
        /// What is wrong with it.
        reason: String,
    },
}

/// Ends the name of a text that was changed by overrides: its lines are not those of the file.
const WITH_OVERRIDES: &str = " with --set";

/// A configuration text with where it came from.
#[derive(Clone, Debug)]
pub struct ConfigText {
    /// Name for messages, usually a path.
    pub file: String,
    /// The TOML text.
    pub text: String,
}

impl ConfigText {
    /// Applies `key.path=value` overrides; the values are TOML, bare words count as strings, and no
    /// value at all removes the key.
    ///
    /// # Errors
    /// When the text is not TOML, or an override is malformed.
    pub fn with_overrides(self, overrides: &[String]) -> Result<Self, ConfigError> {
        if overrides.is_empty() {
            return Ok(self);
        }
        let mut root: toml::Table =
            toml::from_str(&self.text).map_err(|e| self.format_error(&e))?;
        for argument in overrides {
            apply_override(&mut root, argument).map_err(|reason| ConfigError::Override {
                argument: argument.clone(),
                reason,
            })?;
        }
        Ok(Self {
            file: format!("{}{WITH_OVERRIDES}", self.file),
            text: root.to_string(),
        })
    }

    /// Reads and checks a configuration.
    ///
    /// # Errors
    /// Unknown keys, wrong types, missing facts and values outside their range.
    pub fn read<C: DeserializeOwned + Parameters>(&self) -> Result<C, ConfigError> {
        let config: C = toml::from_str(&self.text).map_err(|e| self.format_error(&e))?;
        config.validate().map_err(|error| self.value_error(error))?;
        Ok(config)
    }

    /// The error for a value in this text, with the line of its key.
    pub fn value_error(&self, error: ParameterError) -> ConfigError {
        let line = line_of_key(&self.text, &error.key).filter(|_| !self.is_overridden());
        ConfigError::Value {
            file: self.file.clone(),
            place: line.map_or(String::new(), |n| format!(":{n}")),
            error,
        }
    }

    fn is_overridden(&self) -> bool {
        self.file.ends_with(WITH_OVERRIDES)
    }

    fn format_error(&self, error: &toml::de::Error) -> ConfigError {
        let text = match error.span().filter(|_| self.is_overridden()) {
            Some(span) => {
                let line = line_at(&self.text, span.start);
                format!("in `{line}`: {}", error.message())
            }
            None => error.to_string(),
        };
        let remedy = suggestion(error.message()).map_or(String::new(), |s| format!("\n{s}"));
        ConfigError::Format {
            file: self.file.clone(),
            message: format!("{}{remedy}", text.trim_end()),
        }
    }
}

/// The text of a configuration with every default filled in.
///
/// # Errors
/// When a value cannot be written as TOML.
pub fn resolved_text(config: &impl Serialize) -> Result<String, ConfigError> {
    toml::to_string(config).map_err(|e| ConfigError::Format {
        file: "resolved configuration".into(),
        message: e.to_string(),
    })
}

/// Sets one dotted key in a tree of tables; `name[2]` and `name.2` index arrays.
fn apply_override(root: &mut toml::Table, argument: &str) -> Result<(), String> {
    let (path, value) = argument
        .split_once('=')
        .ok_or("expected key=value, for example mission.hover_s=2")?;
    let path = path.trim().replace('[', ".").replace(']', "");
    let (parents, key) = path.rsplit_once('.').unwrap_or(("", &path));
    if key.is_empty() {
        return Err("the key is empty".into());
    }
    let mut table = root;
    let mut parts = parents.split('.').filter(|p| !p.is_empty()).peekable();
    while let Some(part) = parts.next() {
        let entry = table
            .entry(part.to_owned())
            .or_insert_with(|| toml::Value::Table(toml::Table::new()));
        let entry = match parts.peek().and_then(|p| p.parse::<usize>().ok()) {
            Some(index) => {
                parts.next();
                entry
                    .as_array_mut()
                    .and_then(|array| array.get_mut(index))
                    .ok_or(format!("`{part}` has no element {index}"))?
            }
            None => entry,
        };
        table = entry
            .as_table_mut()
            .ok_or(format!("`{part}` is not a table"))?;
    }
    if value.trim().is_empty() {
        return match table.remove(key) {
            Some(_) => Ok(()),
            None => Err(format!("there is no `{key}` to remove")),
        };
    }
    let value = parse_value(value.trim());
    let value = match (table.get(key), value) {
        (Some(toml::Value::Float(_)), toml::Value::Integer(i)) => toml::Value::Float(i as f64),
        (_, value) => value,
    };
    table.insert(key.to_owned(), value);
    Ok(())
}

/// A TOML value, or a string where the text is not one.
fn parse_value(text: &str) -> toml::Value {
    toml::from_str::<toml::Table>(&format!("v = {text}"))
        .ok()
        .and_then(|mut table| table.remove("v"))
        .unwrap_or_else(|| toml::Value::String(text.to_owned()))
}

/// The line of a text that holds a byte.
fn line_at(text: &str, offset: usize) -> &str {
    let start = text[..offset].rfind('\n').map_or(0, |end| end + 1);
    text[start..].lines().next().unwrap_or("").trim()
}

/// Line (from 1) on which a dotted key stands in a TOML text.
fn line_of_key(text: &str, key: &str) -> Option<usize> {
    let root = toml::de::DeTable::parse(text).ok()?;
    let mut table = root.get_ref();
    let mut place = None;
    for part in key.split('.') {
        let (name, index) = match part.split_once('[') {
            Some((name, index)) => (name, index.trim_end_matches(']').parse::<usize>().ok()),
            None => (part, None),
        };
        let Some(value) = table.get(name) else { break };
        let value = match (value.get_ref(), index) {
            (toml::de::DeValue::Array(array), Some(i)) => array.get(i).unwrap_or(value),
            _ => value,
        };
        place = Some(value.span().start);
        match value.get_ref() {
            toml::de::DeValue::Table(inner) => table = inner,
            _ => break,
        }
    }
    place.map(|offset| text[..offset].matches('\n').count() + 1)
}

/// "did you mean" for an unknown key, from the message that lists the known ones.
fn suggestion(message: &str) -> Option<String> {
    let rest = message.strip_prefix("unknown field `")?;
    let (unknown, rest) = rest.split_once('`')?;
    let nearest = rest
        .split('`')
        .skip(1)
        .step_by(2)
        .map(|known| (edit_distance(unknown, known), known))
        .min()?;
    (nearest.0 <= unknown.len().max(4) / 2)
        .then(|| format!("did you mean `{}`? Names end in their unit.", nearest.1))
}

/// Levenshtein distance in characters.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let substitution = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = substitution.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_parameters::parameters;

    parameters! {
        /// Inner table.
        pub struct Motor {
            /// Limit.
            pub max_speed_m_s: f64 = 2.0, within(0.1, 10.0);
        }
    }
    parameters! {
        /// Outer table.
        pub struct Root {
            /// Name.
            pub name: String = String::new(), any();
            /// Motors.
            pub motors: Vec<Motor> = Vec::new(), nested();
            /// One.
            pub motor: Motor = Motor::default(), nested();
        }
    }

    fn text(text: &str) -> ConfigText {
        ConfigText {
            file: "a.toml".into(),
            text: text.into(),
        }
    }

    fn message(content: &str) -> String {
        text(content).read::<Root>().unwrap_err().to_string()
    }

    #[test]
    fn unknown_keys_are_refused_with_line_and_nearest_name() {
        let found = message("name = \"x\"\n[motor]\nmax_speed_km_h = 3.0\n");
        assert!(found.starts_with("a.toml: "), "{found}");
        assert!(found.contains("line 3"), "{found}");
        assert!(found.contains("did you mean `max_speed_m_s`"), "{found}");
    }

    #[test]
    fn values_out_of_range_are_refused_with_file_line_and_range() {
        let found = message("name = \"x\"\n[motor]\n\nmax_speed_m_s = 30.0\n");
        assert_eq!(
            found,
            "a.toml:4: `motor.max_speed_m_s` is 30; allowed is 0.1 to 10"
        );
        let found = message("[[motors]]\n[[motors]]\nmax_speed_m_s = 30.0\n");
        assert_eq!(
            found,
            "a.toml:3: `motors[1].max_speed_m_s` is 30; allowed is 0.1 to 10"
        );
    }

    #[test]
    fn overrides_reach_nested_tables_and_arrays() {
        let set = |argument: &str| {
            text("[[motors]]\n[[motors]]\n[motor]\nmax_speed_m_s = 1.0\n")
                .with_overrides(&[argument.to_owned()])
                .and_then(|t| t.read::<Root>())
        };
        assert_eq!(
            set("motor.max_speed_m_s=3").unwrap().motor.max_speed_m_s,
            3.0
        );
        assert_eq!(
            set("motors[1].max_speed_m_s=4.5").unwrap().motors[1].max_speed_m_s,
            4.5
        );
        assert_eq!(set("name=pad").unwrap().name, "pad");
        assert_eq!(set("motor.max_speed_m_s=").unwrap().motor, Motor::default());
        assert!(set("motor.min_speed_m_s=").is_err());
        assert!(set("nothing").is_err());
        assert!(
            set("motor.max_speed_m_s=99")
                .unwrap_err()
                .to_string()
                .contains("--set")
        );
        assert!(
            set("motors[7].x=1")
                .unwrap_err()
                .to_string()
                .contains("no element 7")
        );
    }

    #[test]
    fn messages_about_overrides_quote_the_line_and_do_not_count_it() {
        let message = |argument: &str| {
            text("name = \"x\"\n")
                .with_overrides(&[argument.to_owned()])
                .and_then(|t| t.read::<Root>())
                .unwrap_err()
                .to_string()
        };
        assert_eq!(
            message("motor.max_speed_m_s=99"),
            "a.toml with --set: `motor.max_speed_m_s` is 99; allowed is 0.1 to 10"
        );
        let found = message("motor.max_speed_km_h=3");
        assert!(
            found.starts_with("a.toml with --set: in `max_speed_km_h = 3`: unknown field"),
            "{found}"
        );
    }

    #[test]
    fn resolved_text_reads_back_the_same() {
        let config: Root = text("[motor]\nmax_speed_m_s = 1.5\n").read().unwrap();
        let again: Root = text(&resolved_text(&config).unwrap()).read().unwrap();
        assert_eq!(config, again);
    }
}
