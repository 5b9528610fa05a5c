//! Tables as Apache Parquet: one row group, absent numbers as nulls, the log's identity beside them.

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
    try_write(table, about, out).map_err(io::Error::other)
}

fn try_write(
    table: &Table,
    about: &[(String, String)],
    out: impl Write + Send,
) -> Result<(), ParquetError> {
    let about = about.iter().map(|(key, value)| KeyValue::new(key.clone(), value.clone()));
    let properties = WriterProperties::builder().set_key_value_metadata(Some(about.collect()));
    let schema = schema(table)?;
    let mut file = SerializedFileWriter::new(out, schema, Arc::new(properties.build()))?;
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
    file.close()?;
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
