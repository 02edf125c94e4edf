//! Parameters declared once: name with unit, default, range and documentation stand in one place.
//!
//! ```
//! use alula_parameters::{Parameters, parameters};
//!
//! parameters! {
//!     /// A gate for measurements.
//!     pub struct GateConfig {
//!         /// Share of good measurements that pass.
//!         pub probability: f64 = 0.95, within(0.5, 1.0);
//!     }
//! }
//!
//! let config: GateConfig = toml::from_str("probability = 0.99").unwrap();
//! assert!(config.validate().is_ok());
//! let wrong: GateConfig = toml::from_str("probability = 1.5").unwrap();
//! assert_eq!(
//!     wrong.validate().unwrap_err().to_string(),
//!     "`probability` is 1.5; allowed is 0.5 to 1"
//! );
//! assert!(toml::from_str::<GateConfig>("probabilty = 0.9").is_err());
//! ```
//!
//! [`parameters!`] declares a struct in which everything has a default; [`facts!`] one in which
//! everything must be given: physical facts such as a mass have no default.
//! The checks are functions of [`check`]; what is checked is never clamped.

pub mod check;

use std::fmt;

/// A value outside what its declaration allows.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterError {
    /// Dotted path of the key, for example `sensors.imu.rate_hz`.
    pub key: String,
    /// The value found, as text.
    pub found: String,
    /// What is allowed, as text.
    pub allowed: String,
}

impl ParameterError {
    /// An error for `key`, with the value found and a description of what is allowed.
    pub fn new(
        key: impl Into<String>,
        found: impl fmt::Display,
        allowed: impl fmt::Display,
    ) -> Self {
        Self {
            key: key.into(),
            found: found.to_string(),
            allowed: allowed.to_string(),
        }
    }

    /// The same error seen from a table that holds the key under `prefix`.
    pub fn under(mut self, prefix: &str) -> Self {
        self.key = format!("{prefix}.{}", self.key);
        self
    }
}

impl fmt::Display for ParameterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "`{}` is {}; allowed is {}",
            self.key, self.found, self.allowed
        )
    }
}

impl std::error::Error for ParameterError {}

/// A declared set of parameters.
pub trait Parameters {
    /// Checks every value against its declaration.
    ///
    /// # Errors
    /// The first value that is not allowed, with its key.
    fn validate(&self) -> Result<(), ParameterError>;
}

/// Declares a configuration struct in which every parameter has a default.
///
/// Each field is `name: Type = default, check(arguments);` with `check` a function of [`check`].
#[macro_export]
macro_rules! parameters {
    (
        $(#[$meta:meta])*
        pub struct $name:ident {
            $(
                $(#[$field_meta:meta])*
                pub $field:ident : $ty:ty = $default:expr, $check:ident ( $($argument:expr),* );
            )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name {
            $( $(#[$field_meta])* pub $field: $ty, )*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $( $field: $default, )* }
            }
        }

        impl $crate::Parameters for $name {
            fn validate(&self) -> Result<(), $crate::ParameterError> {
                $( $crate::check::$check(&self.$field, stringify!($field) $(, $argument)*)?; )*
                Ok(())
            }
        }
    };
}

/// Declares a struct of facts: every field must be given, there is no default.
///
/// Each field is `name: Type, check(arguments);`.
#[macro_export]
macro_rules! facts {
    (
        $(#[$meta:meta])*
        pub struct $name:ident {
            $(
                $(#[$field_meta:meta])*
                pub $field:ident : $ty:ty, $check:ident ( $($argument:expr),* );
            )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $( $(#[$field_meta])* pub $field: $ty, )*
        }

        impl $crate::Parameters for $name {
            fn validate(&self) -> Result<(), $crate::ParameterError> {
                $( $crate::check::$check(&self.$field, stringify!($field) $(, $argument)*)?; )*
                Ok(())
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    parameters! {
        /// Inner.
        pub struct Inner {
            /// Rate.
            pub rate_hz: f64 = 250.0, within(200.0, 500.0);
        }
    }

    parameters! {
        /// Outer.
        pub struct Outer {
            /// Nested table.
            pub imu: Inner = Inner::default(), nested();
            /// Free text.
            pub name: String = String::from("pad"), any();
            /// Position, m.
            pub start_m: [f64; 3] = [0.0; 3], within(-10.0, 10.0);
            /// Optional.
            pub limit_m: Option<f64> = None, within(0.0, 1.0);
        }
    }

    facts! {
        /// Physical facts.
        pub struct Body {
            /// Mass.
            pub mass_kg: f64, above(0.0);
        }
    }

    fn message(toml_text: &str) -> String {
        toml::from_str::<Outer>(toml_text)
            .unwrap()
            .validate()
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn defaults_are_valid() {
        assert_eq!(Outer::default().validate(), Ok(()));
    }

    #[test]
    fn errors_name_the_whole_path() {
        assert_eq!(
            message("[imu]\nrate_hz = 50.0"),
            "`imu.rate_hz` is 50; allowed is 200 to 500"
        );
        assert_eq!(
            message("start_m = [0.0, 11.0, 0.0]"),
            "`start_m[1]` is 11; allowed is -10 to 10"
        );
        assert_eq!(
            message("limit_m = 2.0"),
            "`limit_m` is 2; allowed is 0 to 1"
        );
    }

    #[test]
    fn not_a_number_is_never_allowed() {
        assert!(message("limit_m = nan").contains("NaN"));
    }

    #[test]
    fn facts_have_no_default() {
        assert!(
            toml::from_str::<Body>("")
                .unwrap_err()
                .to_string()
                .contains("mass_kg")
        );
        let body: Body = toml::from_str("mass_kg = -1.0").unwrap();
        assert_eq!(body.validate().unwrap_err().allowed, "above 0");
    }
}
