//! The checks that a declaration may name. Each takes the value, its name and its own arguments.

use nalgebra::{SVector, UnitQuaternion};

use crate::{ParameterError, Parameters};

/// A value made of numbers that share one range.
pub trait Numbers {
    /// Calls `f` with an index suffix (empty for a scalar) and each number.
    ///
    /// # Errors
    /// The first error of `f`.
    fn for_each(
        &self,
        f: &mut dyn FnMut(&str, f64) -> Result<(), ParameterError>,
    ) -> Result<(), ParameterError>;
}

macro_rules! scalar_numbers {
    ($($ty:ty),*) => {
        $(impl Numbers for $ty {
            fn for_each(
                &self,
                f: &mut dyn FnMut(&str, f64) -> Result<(), ParameterError>,
            ) -> Result<(), ParameterError> {
                f("", *self as f64)
            }
        })*
    };
}
scalar_numbers!(f64, u32, u64, usize, i64);

/// Visits the elements of a sequence with their index.
fn for_each_element<'a, T: Numbers + 'a>(
    values: impl Iterator<Item = &'a T>,
    f: &mut dyn FnMut(&str, f64) -> Result<(), ParameterError>,
) -> Result<(), ParameterError> {
    for (i, value) in values.enumerate() {
        value.for_each(&mut |suffix, number| f(&format!("[{i}]{suffix}"), number))?;
    }
    Ok(())
}

impl<T: Numbers, const N: usize> Numbers for [T; N] {
    fn for_each(
        &self,
        f: &mut dyn FnMut(&str, f64) -> Result<(), ParameterError>,
    ) -> Result<(), ParameterError> {
        for_each_element(self.iter(), f)
    }
}

impl<T: Numbers> Numbers for Vec<T> {
    fn for_each(
        &self,
        f: &mut dyn FnMut(&str, f64) -> Result<(), ParameterError>,
    ) -> Result<(), ParameterError> {
        for_each_element(self.iter(), f)
    }
}

impl<const N: usize> Numbers for SVector<f64, N> {
    fn for_each(
        &self,
        f: &mut dyn FnMut(&str, f64) -> Result<(), ParameterError>,
    ) -> Result<(), ParameterError> {
        for_each_element(self.iter(), f)
    }
}

impl Numbers for UnitQuaternion<f64> {
    fn for_each(
        &self,
        f: &mut dyn FnMut(&str, f64) -> Result<(), ParameterError>,
    ) -> Result<(), ParameterError> {
        for_each_element(self.coords.iter(), f)
    }
}

impl<T: Numbers> Numbers for Option<T> {
    fn for_each(
        &self,
        f: &mut dyn FnMut(&str, f64) -> Result<(), ParameterError>,
    ) -> Result<(), ParameterError> {
        self.as_ref().map_or(Ok(()), |value| value.for_each(f))
    }
}

/// A value that holds declared parameters: one table, several, or an optional one.
pub trait Tables {
    /// Validates every table, with its place in the key.
    ///
    /// # Errors
    /// The first value that is not allowed.
    fn validate_under(&self, name: &str) -> Result<(), ParameterError>;
}

impl<P: Parameters> Tables for P {
    fn validate_under(&self, name: &str) -> Result<(), ParameterError> {
        self.validate().map_err(|e| e.under(name))
    }
}

impl<P: Parameters> Tables for Option<P> {
    fn validate_under(&self, name: &str) -> Result<(), ParameterError> {
        self.as_ref().map_or(Ok(()), |p| p.validate_under(name))
    }
}

impl<P: Parameters> Tables for Vec<P> {
    fn validate_under(&self, name: &str) -> Result<(), ParameterError> {
        for (i, p) in self.iter().enumerate() {
            p.validate_under(&format!("{name}[{i}]"))?;
        }
        Ok(())
    }
}

/// Every number lies in `low..=high`.
///
/// # Errors
/// The first number that does not, or is not a number.
pub fn within(value: &impl Numbers, name: &str, low: f64, high: f64) -> Result<(), ParameterError> {
    value.for_each(&mut |suffix, number| {
        if number >= low && number <= high {
            return Ok(());
        }
        Err(ParameterError::new(
            format!("{name}{suffix}"),
            number,
            format!("{low} to {high}"),
        ))
    })
}

/// Every number lies above `low`, is finite and is not `low` itself.
///
/// # Errors
/// The first number that does not.
pub fn above(value: &impl Numbers, name: &str, low: f64) -> Result<(), ParameterError> {
    value.for_each(&mut |suffix, number| {
        if number > low && number.is_finite() {
            return Ok(());
        }
        Err(ParameterError::new(
            format!("{name}{suffix}"),
            number,
            format!("above {low}"),
        ))
    })
}

/// Every number is finite.
///
/// # Errors
/// The first number that is not.
pub fn finite(value: &impl Numbers, name: &str) -> Result<(), ParameterError> {
    value.for_each(&mut |suffix, number| {
        if number.is_finite() {
            return Ok(());
        }
        Err(ParameterError::new(
            format!("{name}{suffix}"),
            number,
            "a finite number",
        ))
    })
}

/// The value is one or several tables of declared parameters, checked in their turn.
///
/// # Errors
/// The first value in them that is not allowed.
pub fn nested(value: &impl Tables, name: &str) -> Result<(), ParameterError> {
    value.validate_under(name)
}

/// The value is a list of at most `most` tables of declared parameters, checked in their turn.
///
/// # Errors
/// More tables, or the first value in them that is not allowed.
pub fn few<P: Parameters>(value: &Vec<P>, name: &str, most: usize) -> Result<(), ParameterError> {
    if value.len() > most {
        let found = format!("a list of {}", value.len());
        return Err(ParameterError::new(name, found, format!("at most {most}")));
    }
    value.validate_under(name)
}

/// Whatever the type can hold is allowed.
///
/// # Errors
/// None.
pub fn any<T>(_value: &T, _name: &str) -> Result<(), ParameterError> {
    Ok(())
}
