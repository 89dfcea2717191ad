#include "builder/opening/open_own.h"

#include <algorithm>
#include <filesystem>
#include <set>

#include "base/input_formats.h"
#include "builder/opening/formats.h"
#include "builder/opening/input_files.h"
#include "builder/sources/csv/csv_source.h"
#include "builder/sources/generator.h"
#include "builder/sources/numpy/npy_source.h"

namespace splatvol {

tl::unexpected<Error> fail_no_cells(const std::string& input) {
  return fail(ErrorCode::invalid_argument,
              "{}: its values belong to points or voxels; leave out '--cells own', which is for meshes in files",
              input);
}

namespace {

/// A file of an unknown format is a table if its columns are named.
Result<FileHeader> header_of(const std::string& path, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(header, read_header(path));
  if (!options.columns.empty() && !header.format && !format_of_name(path) && !is_foreign(path))
    header.format = InputFormat::table;
  return header;
}

/// Pieces of a data set are different files.
Status refuse_repeated(const std::vector<std::string>& inputs) {
  std::set<std::filesystem::path> seen;
  for (const std::string& input : inputs)
    if (!seen.insert(std::filesystem::path(input).lexically_normal()).second)
      return fail(ErrorCode::invalid_argument, "{}: is given twice", input);
  return {};
}

}  // namespace

Result<std::unique_ptr<Source>> open_own(const std::vector<std::string>& inputs, const SourceOptions& options) {
  const auto generated = std::ranges::find_if(inputs, is_generated);
  if (generated != inputs.end() && inputs.size() > 1)
    return fail(ErrorCode::invalid_argument, "{}: must be the only input", *generated);
  if (generated != inputs.end() && options.cells == CellValues::own) return fail_no_cells(*generated);
  if (generated != inputs.end()) return open_generated(*generated, options);
  SPLATVOL_TRY(refuse_repeated(inputs));

  SPLATVOL_TRY_ASSIGN(paths, expand_folders(inputs));
  if (paths.empty()) return fail(ErrorCode::invalid_argument, "no input file");
  SPLATVOL_TRY_ASSIGN(first, header_of(paths[0], options));
  if (first.format != InputFormat::numpy && first.format != InputFormat::table) return std::unique_ptr<Source>();
  if (options.cells == CellValues::own) return fail_no_cells(paths[0]);
  return first.format == InputFormat::numpy ? open_npy_files(paths, options) : open_csv_files(paths, options);
}

Result<std::optional<std::vector<ArrayShape>>> list_own_arrays(const std::vector<std::string>& inputs,
                                                               const SourceOptions& options) {
  if (std::ranges::any_of(inputs, is_generated)) return std::nullopt;
  SPLATVOL_TRY_ASSIGN(paths, expand_folders(inputs));
  if (paths.empty()) return fail(ErrorCode::invalid_argument, "no input file");
  SPLATVOL_TRY_ASSIGN(first, header_of(paths[0], options));
  const bool is_numpy = first.format == InputFormat::numpy;
  if (!is_numpy && first.format != InputFormat::table) return std::nullopt;
  SPLATVOL_TRY_ASSIGN(arrays, is_numpy ? list_npy_arrays(paths, options) : list_csv_arrays(paths, options));
  return std::optional(std::move(arrays));
}

Result<std::optional<std::vector<ArrayShape>>> list_safely(ReaderProcess& reader,
                                                           const std::vector<std::string>& inputs,
                                                           const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(arrays, list_own_arrays(inputs, options));
  if (arrays || std::ranges::any_of(inputs, is_generated)) return arrays;
  return reader.list_arrays(inputs, options);
}

Result<std::unique_ptr<Source>> open_safely(ReaderProcess& reader, const std::vector<std::string>& inputs,
                                            const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(source, open_own(inputs, options));
  if (!source) return reader.open(inputs, options);
  if (options.time && !source->time_step())
    return fail(ErrorCode::invalid_argument, "{}: no time steps in it to choose from", inputs[0]);
  return source;
}

}  // namespace splatvol
