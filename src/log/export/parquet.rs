//! Tables as Apache Parquet: row groups of some thousand rows, absent numbers as nulls, the log's identity beside them.

use std::io::{self, Write};
use std::sync::Arc;

use parquet::basic::{ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{Type, TypePtr};

use super::tables::{Table, Values};

/// Writes a table, with words about where it came from as metadata of the file.
pub fn write(table: &Table, about: &[(String, String)], out: impl Write + Send) -> io::Result<()> {
    let mut file = Writer::begin(table, about, out)?;
    file.rows(table)?;
    file.finish().map(drop)
}

/// A file that grows by a row group at a time.
pub(super) struct Writer<W: Write + Send> {
    file: SerializedFileWriter<W>,
}

impl<W: Write + Send> Writer<W> {
    /// Begins a file with the columns of `table`.
    pub fn begin(table: &Table, about: &[(String, String)], out: W) -> io::Result<Self> {
        let about = about.iter().map(|(key, value)| KeyValue::new(key.clone(), value.clone()));
        let properties = WriterProperties::builder().set_key_value_metadata(Some(about.collect()));
        let schema = schema(table)?;
        let file = SerializedFileWriter::new(out, schema, Arc::new(properties.build()))?;
        Ok(Self { file })
    }

    /// Its rows as one row group.
    pub fn rows(&mut self, table: &Table) -> io::Result<()> {
        Ok(put(&mut self.file, table)?)
    }

    /// Writes the end of the file.
    pub fn finish(self) -> io::Result<W> {
        Ok(self.file.into_inner()?)
    }
}

fn put<W: Write + Send>(
    file: &mut SerializedFileWriter<W>,
    table: &Table,
) -> Result<(), ParquetError> {
    let mut rows = file.next_row_group()?;
    for column in &table.columns {
        let Some(mut writer) = rows.next_column()? else { break };
        match &column.values {
            Values::Real(v) => {
                let levels: Vec<i16> = v.iter().map(|x| i16::from(x.is_some())).collect();
                let known: Vec<f64> = v.iter().flatten().copied().collect();
                writer.typed::<DoubleType>().write_batch(&known, Some(&levels), None)?;
            }
            Values::Whole(v) => {
                writer.typed::<Int64Type>().write_batch(v, None, None)?;
            }
            Values::Flag(v) => {
                writer.typed::<BoolType>().write_batch(v, None, None)?;
            }
            Values::Text(v) => {
                let texts: Vec<ByteArray> = v.iter().map(|t| t.as_str().into()).collect();
                writer.typed::<ByteArrayType>().write_batch(&texts, None, None)?;
            }
        }
        writer.close()?;
    }
    rows.close()?;
    Ok(())
}

fn schema(table: &Table) -> Result<TypePtr, ParquetError> {
    let mut fields = Vec::new();
    for column in &table.columns {
        let (physical, repetition) = match &column.values {
            Values::Real(_) => (Physical::DOUBLE, Repetition::OPTIONAL),
            Values::Whole(_) => (Physical::INT64, Repetition::REQUIRED),
            Values::Flag(_) => (Physical::BOOLEAN, Repetition::REQUIRED),
            Values::Text(_) => (Physical::BYTE_ARRAY, Repetition::REQUIRED),
        };
        let mut field =
            Type::primitive_type_builder(&column.name, physical).with_repetition(repetition);
        if matches!(column.values, Values::Text(_)) {
            field = field.with_converted_type(ConvertedType::UTF8);
        }
        fields.push(Arc::new(field.build()?));
    }
    Ok(Arc::new(Type::group_type_builder(&table.name).with_fields(fields).build()?))
}
