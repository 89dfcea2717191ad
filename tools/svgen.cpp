// svgen: makes point sets and meshes of any size, to test splatvol and other programs.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <functional>
#include <random>
#include <span>
#include <utility>

#include "base/descriptor.h"
#include "base/file.h"
#include "base/temporary_names.h"
#include "builder/opening/open_own.h"
#include "builder/sources/generator.h"
#include "builder/sources/vtk/writer.h"
#include "tools/reading.h"
#include "tools/refined_source.h"
#include "tools/svgen_flow.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;
static_assert(std::endian::native == std::endian::little);

struct Options {
  std::string output;
  std::string scene;
  std::string count;
  std::string cells;
  std::string pieces;
  std::vector<std::string> meshes;
  std::vector<std::string> attributes;
  int levels = 1;
  std::size_t flow_points = 100000;
  std::string distribution = "uniform";
  std::uint64_t seed = 1;
  bool float32 = false;
  Replace replace = Replace::exports;
  ReadingOptions reading;
};

/// Calls `use` with each piece and its number.
Status for_each_piece(Source& source, const std::function<Status(const Piece&, std::size_t)>& use) {
  ProgressBar bar("generate");
  for (std::size_t i = 0;; ++i) {
    bar.update(static_cast<double>(i) / static_cast<double>(source.piece_count()));
    SPLATVOL_TRY_ASSIGN(piece, source.next());
    if (!piece) return {};
    SPLATVOL_TRY(use(*piece, i));
  }
}

/// Returns the .npy header (version 1.0) of an array with rows of x, y, z and a value. Padding aligns the numbers.
std::string npy_header(std::uint64_t rows, bool float32) {
  std::string text =
      fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}, 4), }}", float32 ? "<f4" : "<f8", rows);
  text.resize(128 - 10 - 1, ' ');
  text += '\n';
  return std::string("\x93NUMPY\1\0", 8) + static_cast<char>(text.size()) + '\0' + text;
}

template <class T>
Status append_rows(const Piece& piece, AtomicFile& file) {
  std::vector<T> rows(4 * piece.points.size());
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis)
      rows[4 * i + static_cast<std::size_t>(axis)] = static_cast<T>(piece.points[i][axis]);
    rows[4 * i + 3] = static_cast<T>(piece.values[0][i]);
  }
  return file.append(std::as_bytes(std::span(rows)));
}

Status write_points(const Options& options) {
  PointRecipe recipe;
  SPLATVOL_TRY_ASSIGN(count, parse_count(options.count));
  recipe.count = count;
  recipe.seed = options.seed;
  recipe.single_precision = options.float32;
  recipe.distribution = static_cast<Distribution>(std::ranges::find(distribution_names(), options.distribution) -
                                                  distribution_names().begin());

  SPLATVOL_TRY(check_outputs({options.output}, {}, options.replace));
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(options.output, AtomicFile::Unnamed::if_possible, options.replace));
  const std::string header = npy_header(count, options.float32);
  SPLATVOL_TRY(file.append(std::as_bytes(std::span(header))));
  const auto source = generate_points(recipe);
  SPLATVOL_TRY(for_each_piece(*source, [&](const Piece& piece, std::size_t) {
    return options.float32 ? append_rows<float>(piece, file) : append_rows<double>(piece, file);
  }));
  return file.commit();
}

/// A folder that gets its name only when it is complete. Without commit, it is removed.
class AtomicFolder {
 public:
  /// Fails if `path` is there and no empty folder, or if it cannot be made.
  static Result<AtomicFolder> create(const std::string& path) {
    std::error_code error;
    if (fs::exists(path, error) && !(fs::is_directory(path, error) && fs::is_empty(path, error)))
      return fail(ErrorCode::io, "{}: is there already, and no empty folder", path);
    const fs::path target = fs::path(path).has_filename() ? fs::path(path) : fs::path(path).parent_path();
    std::random_device random;
    const fs::path temporary = fmt::format("{}.{:08x}{:08x}", target.string(), random(), random());
    if (!fs::create_directory(temporary, error)) return fail(ErrorCode::io, "{}: {}", path, error.message());
    note_temporary(temporary);
    return AtomicFolder(target, temporary);
  }
  AtomicFolder(AtomicFolder&& other) noexcept
      : target_(std::move(other.target_)), temporary_(std::exchange(other.temporary_, {})) {}
  AtomicFolder& operator=(AtomicFolder&&) = delete;
  ~AtomicFolder() {
    if (temporary_.empty()) return;
    std::error_code error;
    fs::remove_all(temporary_, error);
    forget_temporary(temporary_);
  }

  /// Returns the path of a file in the folder, valid until commit.
  [[nodiscard]] std::string file(const std::string& name) const { return (temporary_ / name).string(); }

  Status commit() {
    if (uninterrupted([&] { return ::rename(temporary_.c_str(), target_.c_str()); }) != 0)
      return fail(ErrorCode::io, "{}: {}", target_.string(), std::strerror(errno));
    forget_temporary(temporary_);
    temporary_.clear();
    return {};
  }

 private:
  AtomicFolder(fs::path target, fs::path temporary) : target_(std::move(target)), temporary_(std::move(temporary)) {}

  fs::path target_;
  fs::path temporary_;
};

/// Returns values in the type that our .vtu files have.
std::vector<float> to_floats(const std::vector<double>& values) { return {values.begin(), values.end()}; }

/// Writes the pieces of a mesh into files of a folder, with a .pvtu file that names them.
Status write_pieces(Source& source, const std::string& output) {
  SPLATVOL_TRY_ASSIGN(folder, AtomicFolder::create(output));
  std::string index =
      "<VTKFile type=\"PUnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\">\n<PUnstructuredGrid "
      "GhostLevel=\"0\">\n<PPointData>";
  for (const std::string& name : source.attributes())
    index += fmt::format("<PDataArray type=\"Float32\" Name=\"{}\"/>", name);
  index +=
      "</PPointData>\n<PPoints><PDataArray type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\"/></PPoints>\n";
  SPLATVOL_TRY(for_each_piece(source, [&](const Piece& piece, std::size_t i) {
    const std::string name = fmt::format("piece{}.vtu", i);
    index += fmt::format("<Piece Source=\"{}\"/>\n", name);
    std::vector<PointArray> arrays;
    for (std::size_t a = 0; a < piece.values.size(); ++a)
      arrays.push_back({source.attributes()[a], 1, to_floats(piece.values[a])});
    return write_vtu(folder.file(name), piece.points, piece.tetrahedra, arrays);
  }));
  SPLATVOL_TRY(write_text_file(folder.file("mesh.pvtu"), index + "</PUnstructuredGrid>\n</VTKFile>\n"));
  return folder.commit();
}

Status write_mesh(const Options& options) {
  MeshRecipe recipe;
  SPLATVOL_TRY(store(parse_count(options.cells), recipe.cells));
  if (!options.pieces.empty()) {
    SPLATVOL_TRY(store(parse_count(options.pieces), recipe.pieces));
  }
  SPLATVOL_TRY_ASSIGN(source, generate_mesh(recipe));
  return write_pieces(*source, options.output);
}

Status write_refined(const Options& options) {
  SPLATVOL_TRY_ASSIGN(reader_options, reader_options_of(options.reading, 0));
  warn_of_left_out(options.meshes);
  ReaderProcess reader(reader_options);
  SPLATVOL_TRY_ASSIGN(source, open_safely(reader, options.meshes, {options.attributes, {}}));
  for (const std::string& name : source->attributes())
    if (name.find_first_of("&<>\"") != std::string::npos)
      return fail(ErrorCode::unsupported, "{}: attribute '{}': VTK's writer makes no file of such a name",
                  options.meshes.front(), name);
  const auto refined = refine(std::move(source), options.levels, options.meshes.front());
  return write_pieces(*refined, options.output);
}

Status write_flow_files(const Options& options) {
  SPLATVOL_TRY(check_outputs({options.output, options.scene}, {}, options.replace));
  if (!options.output.empty()) SPLATVOL_TRY(write_flow(options.output, options.flow_points, options.replace));
  return options.scene.empty() ? Status{} : write_flow_scene(options.scene);
}

// These return the subcommand that they add.
CommandLine* add_points_command(CommandLine& app, Options& options) {
  CommandLine* command = app.add_subcommand("points", "Scattered points, as a table of x, y, z, value");
  command->add_option("-o,--output", options.output, "The file to write (.npy)")
      ->type_name("OUT.npy")
      ->required()
      ->check(check_npy_path);
  command->add_option("--count", options.count, "Number of points, such as 1e8")
      ->type_name("N")
      ->required()
      ->check(check_of(parse_count));
  command
      ->add_option(
          "--distribution", options.distribution,
          "Distribution; vortex has more points where the field varies, clusters has half of the points in 200 "
          "normal clusters with deviations from 1e-3 to 1e-1, in and among the others")
      ->type_name("NAME")
      ->one_of(distribution_names())
      ->capture_default_str();
  command->add_option("--seed", options.seed, "Another seed gives other points")->capture_default_str();
  command->add_flag("--float32,!--float64", options.float32, "Numbers of 4 bytes, or of 8 (default)");
  add_force_option(*command, options.replace);
  return command;
}

CommandLine* add_mesh_command(CommandLine& app, Options& options) {
  CommandLine* command =
      app.add_subcommand("mesh", "A graded mesh of tetrahedra in pieces, with a .pvtu that names them");
  command->add_option("-o,--output", options.output, "The folder to write")
      ->type_name("DIR")
      ->required()
      ->check(check_not_empty);
  command->add_option("--cells", options.cells, "Approximate number of tetrahedra, such as 1e8")
      ->type_name("N")
      ->required()
      ->check(check_of(parse_count));
  command->add_option("--pieces", options.pieces, "Number of files (default: some 1.5 million tetrahedra in each)")
      ->type_name("N")
      ->check(check_of(parse_count));
  return command;
}

CommandLine* add_refine_command(CommandLine& app, Options& options) {
  CommandLine* command =
      app.add_subcommand("refine", "The same shape and field as a given mesh in more tetrahedra, in pieces too");
  command->add_option("MESH", options.meshes, "Any input of svbuild that has cells")->type_name("IN...")->required();
  command->add_option("-o,--output", options.output, "The folder to write")
      ->type_name("DIR")
      ->required()
      ->check(check_not_empty);
  command->add_option("--levels", options.levels, "How often each tetrahedron is split into eight")
      ->range(1, most_refinements)
      ->capture_default_str();
  command->add_option("--attribute", options.attributes, "Attributes to keep (default: all)")->type_name("NAME");
  add_reading_options(*command, options.reading);
  return command;
}

CommandLine* add_flow_command(CommandLine& app, Options& options) {
  CommandLine* command = app.add_subcommand(
      "flow", "A mesh to try splatvol on: a knotted vortex, fine where the flow varies; and a scene that shows it");
  command->add_option("-o,--output", options.output, "The mesh to write (.vtu)")
      ->type_name("OUT.vtu")
      ->check([](const std::string& path) {
        return has_extension(path, ".vtu") ? "" : "'" + path + "' does not end in .vtu";
      });
  command->add_option("--points", options.flow_points, "Approximate number of points")
      ->range(1000, 100'000'000)
      ->capture_default_str();
  command->add_option("--scene", options.scene, "The scene file to write (.json)")
      ->type_name("OUT.json")
      ->check(check_json_path);
  add_force_option(*command, options.replace);
  command->callback([&] {
    if (options.output.empty() && options.scene.empty()) missing_option("-o or --scene");
  });
  return command;
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  CommandLine app(
      "Makes point sets and meshes of any size with an analytic field, \"value\". The same without a file: "
      "svbuild gen:points:count=1e8,distribution=vortex,seed=1,type=float32 or gen:mesh:cells=1e8,pieces=64",
      "svgen");
  Options options;
  app.require_subcommand();

  CommandLine* const points = add_points_command(app, options);
  add_mesh_command(app, options);
  CommandLine* const refined = add_refine_command(app, options);
  CommandLine* const flow = add_flow_command(app, options);
  return run_tool(app, argc, argv, [&] {
    if (flow->is_given()) return write_flow_files(options);
    if (refined->is_given()) return write_refined(options);
    return points->is_given() ? write_points(options) : write_mesh(options);
  });
}
