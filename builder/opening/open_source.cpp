#include "builder/opening/open_source.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "base/input_formats.h"
#include "base/printable.h"
#include "builder/opening/formats.h"
#include "builder/opening/input_files.h"
#include "builder/opening/open_own.h"
#include "builder/sources/cgns/cgns_reader.h"
#include "builder/sources/data_sets_source.h"
#include "builder/sources/ensight/ensight_case.h"
#include "builder/sources/ensight/ensight_reader.h"
#include "builder/sources/exodus/exodus_reader.h"
#include "builder/sources/file_data_sets.h"
#include "builder/sources/gmsh/gmsh_reader.h"
#include "builder/sources/openfoam/openfoam_reader.h"
#include "builder/sources/openvdb/vdb_source.h"
#include "builder/sources/plot3d/plot3d_reader.h"
#include "builder/sources/read_text.h"
#include "builder/sources/su2/su2_reader.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/collections.h"
#include "builder/sources/vtk/legacy_checks.h"
#include "builder/sources/vtk/legacy_reader.h"
#include "builder/sources/vtk/xml_reader.h"
#include "builder/sources/vtkhdf/vtkhdf_reader.h"

namespace splatvol {
namespace {

bool newer_than(const FileHeader& header, int major, int minor) {
  return header.major > major || (header.major == major && header.minor > minor);
}

tl::unexpected<Error> fail_version(const std::string& path, const FileHeader& header, const char* newest) {
  return fail(ErrorCode::unsupported,
              "{}: file version {}.{} is newer than {}, the newest that this version reads right", path, header.major,
              header.minor, newest);
}

/// Checks the version here, because VTK at most warns of a newer major version, and reads what it recognises. The
/// polyhedra of version 2.3 are read by builder/sources/vtk/unstructured_reader.cpp.
Result<InputFile> identify_xml(const std::string& path, const FileHeader& header) {
  const auto reader = xml_reader_of(header.type);
  if (!reader) return fail(ErrorCode::unsupported, "{}: VTK files of type \"{}\" are not supported", path, header.type);
  if (newer_than(header, 2, 3)) return fail_version(path, header, "2.3");
  return InputFile{path, *reader};
}

/// A file that names files is not one of those that it names, at any depth.
constexpr int deepest_nesting = 16;

/// The files that files name, each looked at once.
class KnownFiles {
 public:
  Result<FileHeader> header(const std::string& path) {
    const std::string file = canonical(path);
    const auto known = headers_.find(file);
    if (known != headers_.end()) return known->second;
    SPLATVOL_TRY_ASSIGN(header, read_header(path));
    return headers_[file] = std::move(header);
  }

  /// Returns the files that a parallel or composite file names; those of a parallel one are in no block.
  Result<std::vector<BlockFile>> names(const std::string& path, const FileHeader& header) {
    const std::string file = canonical(path);
    const auto known = names_.find(file);
    if (known != names_.end()) return known->second;
    if (header.format == InputFormat::vtk_blocks) {
      SPLATVOL_TRY_ASSIGN(blocks, block_files(path));
      return names_[file] = std::move(blocks);
    }
    SPLATVOL_TRY_ASSIGN(parallel, read_parallel_file(path));
    std::vector<BlockFile> files;
    for (const std::string& piece : parallel.pieces) files.push_back({piece});
    if (!parallel.arrays.empty()) declared_.push_back({path, std::move(parallel.arrays)});
    return names_[file] = std::move(files);
  }

  /// Counts a file and those that it names, at any depth, as often as they are named. A file that cannot be read counts
  /// as one. A few files that name each other can stand for more files than anybody can read.
  double count(const std::string& path, int nesting = 0) {
    const auto [known, is_new] = counts_.try_emplace(canonical(path), 1.0);
    if (!is_new || nesting == deepest_nesting) return known->second;
    const auto header = this->header(path);
    if (!header || (header->format != InputFormat::vtk_blocks && header->format != InputFormat::vtk_parallel)) return 1;
    const auto names = this->names(path, *header);
    if (!names) return 1;
    double sum = 1;
    for (const BlockFile& name : *names) sum += count(name.path, nesting + 1);
    return known->second = sum;
  }

  /// The arrays that parallel files among them declare, once.
  std::vector<DeclaredArrays> take_declared() { return std::exchange(declared_, {}); }

  /// Returns the one path of a file that may have many, by links and "..". The file itself may be a link: what it names
  /// lies where the link does.
  std::string canonical(const std::string& path) {
    const std::filesystem::path given(path), folder = given.has_parent_path() ? given.parent_path() : ".";
    const auto [known, is_new] = folders_.try_emplace(folder.string(), folder);
    std::error_code error;
    if (is_new)
      if (auto found = std::filesystem::canonical(folder, error); !error) known->second = std::move(found);
    return known->second / given.filename();
  }

 private:
  std::map<std::string, std::filesystem::path> folders_;
  std::map<std::string, FileHeader> headers_;
  std::map<std::string, std::vector<BlockFile>> names_;
  std::map<std::string, double> counts_;
  std::vector<DeclaredArrays> declared_;
};

/// Appends the pieces that a parallel file names.
Status append_pieces(const std::string& path, const FileHeader& of_path, std::vector<InputFile>& files,
                     KnownFiles& known) {
  SPLATVOL_TRY_ASSIGN(pieces, known.names(path, of_path));
  for (const auto& [piece, block] : pieces) {
    const auto header = known.header(piece);
    if (!header) return fail_in(path, header.error());
    if (header->format != InputFormat::vtk_xml || header->type != of_path.type.substr(1))
      return fail(ErrorCode::invalid_data, "{}: its piece {} is not a file of the type \"{}\"", path, piece,
                  of_path.type.substr(1));
    SPLATVOL_TRY_ASSIGN(file, identify_xml(piece, *header));
    files.push_back(file);
  }
  return {};
}

/// Appends a file to those that are read. `nesting`: how many files name each other on the way to it.
Status append_file(const std::string& path, std::vector<InputFile>& files, KnownFiles& known, int nesting = 0);

/// Appends a file that names the files of its blocks. Errors of these begin with the name of the outermost such file.
Status append_composite(const std::string& path, const FileHeader& header, std::vector<InputFile>& files,
                        KnownFiles& known, int nesting) {
  if (nesting == deepest_nesting) return fail(ErrorCode::invalid_data, "{}: files name each other too deeply", path);
  SPLATVOL_TRY_ASSIGN(names, known.names(path, header));
  InputFile composite{path, {}};
  for (const auto& [name, block] : names) {
    const std::size_t before = composite.blocks.size();
    if (const Status added = append_file(name, composite.blocks, known, nesting + 1); !added) {
      const bool named = nesting > 0 || added.error().message.starts_with(one_line(path) + ": ");
      return named ? added : Status(fail_in(path, added.error()));
    }
    for (std::size_t i = before; i < composite.blocks.size(); ++i) composite.blocks[i].block = block;
  }
  files.push_back(std::move(composite));
  return {};
}

/// Lists the arrays of a file that is one data set.
template <Result<std::vector<ArrayShape>> (*list)(const std::string& path)>
Result<ArraysOfParts> list_arrays_of(const InputFile& file) {
  SPLATVOL_TRY_ASSIGN(arrays, list(file.path));
  return ArraysOfParts(1, std::move(arrays));
}

// The readers of meshes. A format that is not here does not compile without a warning.
Status append_file(const std::string& path, std::vector<InputFile>& files, KnownFiles& known, int nesting) {
  SPLATVOL_TRY_ASSIGN(header, known.header(path));
  if (!header.format && is_foreign(path)) return fail(ErrorCode::unsupported, "{}: {}", path, way_out(path));
  if (!header.format)
    return fail(ErrorCode::invalid_data, "{}: not a VTK file (neither \"<VTKFile\" nor \"# vtk DataFile\" in it)",
                path);
  const auto append = [&](const FileReader& reader) -> Status {
    files.push_back({path, reader});
    return {};
  };
  switch (*header.format) {
    case InputFormat::vtk_parallel:
      return append_pieces(path, header, files, known);
    case InputFormat::vtk_blocks:
      return append_composite(path, header, files, known, nesting);
    case InputFormat::vtk_series:
      return fail(ErrorCode::invalid_argument, "{}: a series of files must be the only input", path);
    case InputFormat::vtk_xml: {
      SPLATVOL_TRY_ASSIGN(file, identify_xml(path, header));
      files.push_back(std::move(file));
      return {};
    }
    case InputFormat::vtk_legacy:
      if (newer_than(header, 5, 1)) return fail_version(path, header, "5.1");
      return append({open_legacy, list_arrays_of<legacy_arrays>});
    case InputFormat::vtkhdf:
      return append({open_vtkhdf});
    case InputFormat::exodus:
      return append({open_exodus});
    case InputFormat::cgns:
      return append({open_cgns});
    case InputFormat::ensight:
      return append({open_ensight, list_arrays_of<ensight_arrays>});
    case InputFormat::openfoam:
      return append({open_openfoam});
    case InputFormat::gmsh:
      return append({open_gmsh, list_gmsh_arrays});
    case InputFormat::su2:
      return append({open_su2, list_su2_arrays});
    case InputFormat::plot3d:
    case InputFormat::openvdb:
    case InputFormat::numpy:
    case InputFormat::table:
      break;
  }
  return fail(ErrorCode::invalid_argument, "{}: a file of {} among meshes", path, name_of(*header.format));
}

/// Files that a list names, each once.
class ListedFiles {
 public:
  explicit ListedFiles(KnownFiles& known) : known_(known) {}

  /// Whether a file is named for the first time.
  bool add(const std::string& path) {
    const bool is_new = seen_.insert(known_.canonical(path)).second;
    if (!is_new) twice_.insert(std::filesystem::path(path).filename().string());
    return is_new;
  }

  /// Leaves out files and blocks that were named before.
  void keep_new(std::vector<InputFile>& files) {
    std::erase_if(files, [&](InputFile& file) {
      if (!file.is_composite()) return !add(file.path);
      keep_new(file.blocks);
      return file.blocks.empty();
    });
  }

  /// Adds a line on the files that `list` names several times, if there are any.
  void tell(const std::string& list, std::vector<std::string>& notes) const {
    constexpr std::size_t most_names = 5;
    if (twice_.empty()) return;
    std::vector<std::string> names(twice_.begin(), twice_.end());
    if (names.size() > most_names) {
      names.resize(most_names);
      names.push_back(fmt::format("{} more", twice_.size() - most_names));
    }
    notes.push_back(
        fmt::format("{}: files that are named more than once count once: {}", list, fmt::join(names, ", ")));
  }

 private:
  KnownFiles& known_;
  std::set<std::string> seen_, twice_;
};

std::string normal_path(const InputFile& file) { return std::filesystem::path(file.path).lexically_normal().string(); }

void collect_blocks(const InputFile& file, std::set<std::string>& paths) {
  for (const InputFile& block : file.blocks) {
    paths.insert(normal_path(block));
    collect_blocks(block, paths);
  }
}

/// Drops repeated files: a folder may hold a .pvtu or .vtm and the files that it names.
void drop_repeated(std::vector<InputFile>& files) {
  std::set<std::string> seen;
  for (const InputFile& file : files) collect_blocks(file, seen);
  std::erase_if(files, [&](const InputFile& file) { return !seen.insert(normal_path(file)).second; });
}

Status check_count(const std::vector<std::string>& paths, KnownFiles& known) {
  constexpr double most_files = 0x1p20;
  double count = 0;
  for (const std::string& path : paths) count += known.count(path);
  if (count <= most_files) return {};
  return fail(ErrorCode::unsupported,
              "{}: it and the files that it names stand for {:.3g} files, and at most {} are read", paths[0], count,
              most_files);
}

/// Replaces a series of files by those of its step nearest to `time`, without a time the last. Returns the step, or
/// nothing if the input is no series of files.
Result<std::optional<TimeStep>> expand_series(std::vector<std::string>& paths, const FileHeader& first,
                                              std::optional<double> time, KnownFiles& known) {
  if (first.format != InputFormat::vtk_series || paths.size() != 1) return std::optional<TimeStep>();
  SPLATVOL_TRY_ASSIGN(steps, collection_steps(paths[0]));
  std::vector<double> times;
  for (const auto& of_collection : steps) times.push_back(of_collection.time);
  std::optional<TimeStep> step = choose_step(times, time);
  const std::string collection = paths[0];
  paths = steps[step->index].files;
  for (const std::string& path : paths)
    if (const auto header = known.header(path); !header) return fail_in(collection, header.error());
  return step;
}

/// Files with data sets, and the time step that they are.
struct Input {
  std::vector<InputFile> files;
  std::optional<TimeStep> step;
  InputLists lists = {};
};

/// `paths`: `inputs` with the files of folders; `first`: the header of the first.
Result<Input> find_files(std::vector<std::string> paths, const std::vector<std::string>& inputs,
                         const FileHeader& first, const SourceOptions& options) {
  Input input;
  KnownFiles known;
  SPLATVOL_TRY_ASSIGN(step, expand_series(paths, first, options.time, known));
  SPLATVOL_TRY(check_count(paths, known));
  input.step = step;
  if (step) {
    ListedFiles listed(known);
    std::erase_if(paths, [&](const std::string& path) { return !listed.add(path); });
    listed.tell(inputs[0], input.lists.notes);
  }
  for (std::size_t i = 0; i < paths.size(); ++i) {
    std::vector<InputFile> files;
    SPLATVOL_TRY(append_file(paths[i], files, known));
    ListedFiles listed(known);
    listed.keep_new(files);
    listed.tell(paths[i], input.lists.notes);
    std::ranges::move(files, std::back_inserter(input.files));
    // A .csv behind an SU2 mesh holds its values.
    if (input.files.back().reader.open == open_su2 && i + 1 < paths.size() &&
        format_of_name(paths[i + 1]) == InputFormat::table)
      input.files.back().values = paths[++i];
  }
  if (paths != inputs) drop_repeated(input.files);
  ListedFiles listed(known);  // several lists may name one file
  listed.keep_new(input.files);
  listed.tell("the inputs", input.lists.notes);
  if (input.files.empty()) return fail(ErrorCode::invalid_data, "{}: names no pieces", paths[0]);
  for (InputFile& file : input.files) file.patches = options.patches;
  input.lists.declared = known.take_declared();
  return input;
}

bool is_plot3d(const FileHeader& first, const std::string& path) {
  return !first.format && !format_of_name(path) && !is_foreign(path);
}

Result<std::unique_ptr<Source>> open_any(const std::vector<std::string>& inputs, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(own, open_own(inputs, options));
  if (own) return own;
  SPLATVOL_TRY_ASSIGN(paths, expand_folders(inputs));
  SPLATVOL_TRY_ASSIGN(first, read_header(paths[0]));
  if (!options.columns.empty())
    return fail(ErrorCode::invalid_argument, "{}: neither a .npy nor a .csv file, so its columns cannot be named",
                paths[0]);
  if (first.format == InputFormat::openvdb) {
    if (options.cells == CellValues::own) return fail_no_cells(paths[0]);
    return open_vdb_files(paths, options);
  }
  if (is_plot3d(first, paths[0])) {
    if (paths.size() == 2)
      return open_files({{.path = paths[0], .reader = {open_plot3d}, .values = paths[1]}}, options);
    return fail(
        ErrorCode::invalid_argument,
        "{}: its format is not known ('svbuild --help' lists those that are read); a table needs the names of its "
        "columns (--columns x,y,z,...), a PLOT3D grid its solution or functions as the second of two files",
        paths[0]);
  }
  SPLATVOL_TRY_ASSIGN(input, find_files(std::move(paths), inputs, first, options));
  return open_files(std::move(input.files), options, input.step, std::move(input.lists));
}

}  // namespace

Result<std::unique_ptr<Source>> open_source(const std::vector<std::string>& inputs, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(source, open_any(inputs, options));
  if (options.time && !source->time_step())
    return fail(ErrorCode::invalid_argument, "{}: no time steps in it to choose from", inputs[0]);
  return source;
}

Result<std::optional<std::vector<ArrayShape>>> list_arrays(const std::vector<std::string>& inputs,
                                                           const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(own, list_own_arrays(inputs, options));
  if (own) return own;
  SPLATVOL_TRY_ASSIGN(paths, expand_folders(inputs));
  SPLATVOL_TRY_ASSIGN(first, read_header(paths[0]));
  if (first.format == InputFormat::openvdb) {
    SPLATVOL_TRY_ASSIGN(grids, list_vdb_grids(paths));
    return std::optional(std::move(grids));
  }
  if (is_plot3d(first, paths[0])) return std::nullopt;
  SPLATVOL_TRY_ASSIGN(input, find_files(std::move(paths), inputs, first, options));
  ArrayUnion arrays;
  SPLATVOL_TRY(read_files(input.files, options)->announce(arrays));
  return std::optional(arrays.arrays());
}

}  // namespace splatvol
