//! Tables: numbers whose rows and columns have names.

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;

/// Numbers in rows and columns: what was measured of each marker.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "validate")]
pub struct Table {
    /// The numbers, in the unit that their maker states; NaN where there is none.
    #[value(shape = "[n, k]")]
    pub values: NdArray<f64, 2>,
    /// Name of each row, or none at all.
    #[value(text)]
    pub rows: Vec<String>,
    /// Name of each column, or none at all.
    #[value(text)]
    pub columns: Vec<String>,
}

impl Table {
    /// The numbers of the column `name`, from the first row on.
    pub fn column(&self, name: &str) -> Option<Vec<f64>> {
        let at = self.columns.iter().position(|c| c == name)?;
        let [n, k] = self.values.shape();
        Some((0..n).map(|row| self.values.data()[row * k + at]).collect())
    }

    /// What keeps the parts from being a table.
    ///
    /// # Errors
    /// Where there are names, but not one for each row or column, or two columns of one name.
    pub fn validate(&self) -> Result<(), String> {
        let [n, k] = self.values.shape();
        for (what, names, count) in [("rows", &self.rows, n), ("columns", &self.columns, k)] {
            if !names.is_empty() && names.len() != count {
                return Err(format!("expected a name for each of {count} {what} or none, found {}", names.len()));
            }
        }
        let twice = self.columns.iter().enumerate().find(|(i, name)| self.columns[..*i].contains(name));
        twice.map_or(Ok(()), |(_, name)| Err(format!("expected one column of each name, found two `{name}`")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(rows: &[&str], columns: &[&str]) -> Table {
        let names = |list: &[&str]| list.iter().map(|n| (*n).to_owned()).collect();
        Table { values: NdArray::new([2, 2], vec![1.0, 2.0, 3.0, 4.0]).unwrap(), rows: names(rows), columns: names(columns) }
    }

    #[test]
    fn columns_are_found_by_name() {
        let table = table(&["a", "b"], &["rms", "max"]);
        assert_eq!((table.column("max"), table.column("mean")), (Some(vec![2.0, 4.0]), None));
    }

    #[test]
    fn tables_have_all_names_or_none() {
        assert_eq!(table(&[], &[]).validate(), Ok(()));
        assert_eq!(table(&["a"], &[]).validate(), Err("expected a name for each of 2 rows or none, found 1".to_owned()));
        assert_eq!(table(&[], &["a", "a"]).validate(), Err("expected one column of each name, found two `a`".to_owned()));
    }
}
