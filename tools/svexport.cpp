// svexport: a .svol file in; voxels (.vdb), points or cells (.vtu), a contour (.vtp, .stl, .glb), a line of sight
// (.csv), or streamlines (.vtp, .csv) out.
#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/json.h"
#include "sampler/line_export.h"
#include "tools/ending.h"
#include "tools/export/cell_export.h"
#include "tools/export/contour_export.h"
#include "tools/export/streamline_export.h"
#include "tools/export/vdb_export.h"
#include "tools/export/vtu_export.h"
#include "tools/progress_lines.h"
#include "tools/steps.h"
#include "tools/streamline_options.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

using json = nlohmann::ordered_json;

struct Options {
  std::string file;
  StepChoice step;
  std::string output;
  std::vector<std::string> attributes;
  std::optional<std::size_t> resolution;
  std::vector<double> box;
  bool cells = false;
  std::optional<double> contour;
  std::string line;
  std::optional<std::size_t> samples;
  StreamlineOptions streamlines;
  double voxel = 0;
  std::string memory;
  Replace replace = Replace::exports;
  bool json = false, progress = false;

  [[nodiscard]] bool is_vdb() const { return output.ends_with(".vdb"); }
  [[nodiscard]] bool is_table() const { return output.ends_with(".csv"); }
  [[nodiscard]] bool is_surface() const {
    return output.ends_with(".vtp") || output.ends_with(".stl") || output.ends_with(".glb");
  }
};

// Returns the six numbers of two positions.
Result<std::vector<double>> parse_line(const std::string& text) {
  std::vector<double> numbers;
  const char* at = text.c_str();
  for (const char separator : {',', ',', ':', ',', ',', '\0'}) {
    char* end = nullptr;
    numbers.push_back(std::strtod(at, &end));
    if (end == at || *end != separator || !std::isfinite(numbers.back()))
      return fail(ErrorCode::invalid_argument, "'{}' is not two positions, such as 0,0,0:1,0,0", text);
    at = end + 1;
  }
  return numbers;
}

void check_streamline_usage(const Options& options) {
  const StreamlineOptions& streamlines = options.streamlines;
  if (!streamlines.are_given()) {
    if (!streamlines.seeds.empty() || streamlines.direction != "both" || streamlines.length || streamlines.steps)
      missing_option("--streamlines");
    return;
  }
  if (streamlines.seeds.empty()) missing_option("--seeds");
  if (!options.output.ends_with(".vtp") && !options.is_table())
    wrong_option("--streamlines", "is for .vtp and .csv files");
  if (options.contour || !options.line.empty()) wrong_option("--streamlines", "stands alone");
  if (!options.box.empty()) wrong_option("--box", "streamlines have no box");
}

// Checks the options against each other: CLI11 sees only one option at a time.
void check_usage(const Options& options) {
  if (!options.is_vdb() && !options.output.ends_with(".vtu") && !options.is_surface() && !options.is_table())
    wrong_option("--output", "must end in .vdb, .vtu, .vtp, .stl, .glb or .csv");
  if (options.is_vdb() && options.voxel == 0) missing_option("--voxel");
  if (!options.is_vdb() && options.voxel != 0) wrong_option("--output", "--voxel is for .vdb files");
  check_streamline_usage(options);
  const bool has_streamlines = options.streamlines.are_given();
  if (!options.is_vdb() && !options.contour && !has_streamlines && !options.memory.empty())
    wrong_option("--output", "--memory is for .vdb files, contours and streamlines");
  if (options.cells && !options.output.ends_with(".vtu")) wrong_option("--cells", "is for .vtu files");
  if (options.is_surface() && !options.contour && !has_streamlines) missing_option("--contour");
  if (options.contour && !options.is_surface()) wrong_option("--contour", "is for .vtp, .stl and .glb files");
  if (options.contour && options.attributes.size() > 1 && !options.output.ends_with(".vtp"))
    wrong_option("--attribute", "only .vtp files have values: take the attribute of the contour alone");
  if (options.is_table() && options.line.empty() && !has_streamlines) missing_option("--line");
  if (!options.line.empty() && !options.is_table()) wrong_option("--line", "is for .csv files");
  if (!options.line.empty() && !options.box.empty()) wrong_option("--box", "a line has no box");
  if (options.samples && options.line.empty()) wrong_option("--samples", "is for --line");
  if ((options.cells || options.contour || !options.line.empty() || has_streamlines) && options.resolution)
    wrong_option("--resolution", "cells have no resolutions: leave it out");
  for (std::size_t axis = 0; axis < 3 && !options.box.empty(); ++axis)
    if (!(options.box[axis] <= options.box[axis + 3])) wrong_option("--box", "the first corner must be the lower one");
}

std::function<void(double)> show_progress(const Options& options) {
  if (options.progress)
    return [lines = std::make_shared<ProgressLines>()](double share) {
      if (lines->is_due()) lines->print({{"share", share}});
    };
  return [bar = std::make_shared<ProgressBar>("exporting")](double fraction) { bar->update(fraction); };
}

Result<json> export_voxels(const format::Volume& volume, const format::SplatSelection& selection,
                           const Options& options) {
  SPLATVOL_TRY_ASSIGN(memory, memory_or_quarter(options.memory));
  const auto progress = show_progress(options);
  SPLATVOL_TRY_ASSIGN(report,
                      export_vdb(volume, options.output, selection, options.voxel, memory, progress, options.replace));
  return json{{"output", options.output},        {"splats", report.splats},         {"voxels", report.voxels},
              {"splat_mass", report.splat_mass}, {"voxel_mass", report.voxel_mass}, {"file_bytes", report.file_bytes},
              {"renamed", report.renamed}};
}

// A report with the errors of the file's numbers.
json with_errors(json report, const format::Volume& volume, const format::SplatSelection& selection) {
  report["position_error"] = volume.info().position_error;
  json& errors = report["value_errors"] = json::object();
  for (std::size_t i = 0; i < selection.attributes.size(); ++i)
    errors[selection.names[i]] = volume.info().attributes[selection.attributes[i]].error;
  return report;
}

Result<json> export_mesh(const format::Volume& volume, const format::SplatSelection& selection,
                         const Options& options) {
  const auto progress = show_progress(options);
  SPLATVOL_TRY_ASSIGN(report, export_cells(volume, options.output, selection, progress, options.replace));
  return with_errors({{"output", options.output},
                      {"cells", report.cells},
                      {"points", report.points},
                      {"left_out", report.left_out},
                      {"split", report.split},
                      {"volume", report.volume},
                      {"file_bytes", report.file_bytes},
                      {"renamed", json::object()}},
                     volume, selection);
}

// The surface, and how much it can differ from that of the mesh as it was given.
Result<json> export_surface(const format::Volume& volume, const format::SplatSelection& selection,
                            const Options& options) {
  if (options.attributes.empty() && selection.names.size() > 1)
    return fail(ErrorCode::invalid_argument,
                "{}: has several attributes: --attribute chooses that of the contour, of {}", volume.name(),
                fmt::join(selection.names, ", "));
  SPLATVOL_TRY_ASSIGN(memory, memory_or_quarter(options.memory));
  const auto progress = show_progress(options);
  SPLATVOL_TRY_ASSIGN(
      report, export_contour(volume, options.output, selection, *options.contour, memory, progress, options.replace));
  json result = with_errors({{"output", options.output},
                             {"triangles", report.triangles},
                             {"area", report.area},
                             {"closed", report.closed},
                             {"volume", report.closed ? json(report.volume) : json()},
                             {"left_out", report.left_out},
                             {"file_bytes", report.file_bytes},
                             {"renamed", json::object()}},
                            volume, selection);
  if (report.vertices > 0) result["vertices"] = report.vertices;
  return result;
}

Result<json> export_table(const format::Volume& volume, const format::SplatSelection& selection,
                          const Options& options) {
  SPLATVOL_TRY_ASSIGN(at, parse_line(options.line));
  SPLATVOL_TRY_ASSIGN(report, export_line(volume, options.output, selection, {at[0], at[1], at[2]},
                                          {at[3], at[4], at[5]}, options.samples, options.replace));
  return with_errors({{"output", options.output},
                      {"rows", report.rows},
                      {"length", report.length},
                      {"inside", report.inside},
                      {"file_bytes", report.file_bytes},
                      {"renamed", report.renamed}},
                     volume, selection);
}

Result<json> export_lines_of(const format::Volume& volume, const format::SplatSelection& selection,
                             const Options& options) {
  SPLATVOL_TRY_ASSIGN(memory, memory_or_quarter(options.memory));
  SPLATVOL_TRY_ASSIGN(request, request_of(options.streamlines));
  request.attributes = selection.names;
  SPLATVOL_TRY_ASSIGN(report, export_streamlines(volume, options.output, request, memory, options.replace));
  json ends = json::object();
  for (std::size_t end = 0; end < report.ends.size(); ++end)
    if (report.ends[end] > 0) ends[name_of(static_cast<StreamlineEnd>(end))] = report.ends[end];
  return with_errors({{"output", options.output},
                      {"lines", report.lines},
                      {"seeds", report.seeds},
                      {"points", report.rows},
                      {"ends", ends},
                      {"file_bytes", report.file_bytes},
                      {"renamed", report.renamed}},
                     volume, selection);
}

Result<json> export_points(const format::Volume& volume, const format::SplatSelection& selection,
                           const Options& options) {
  const auto progress = show_progress(options);
  SPLATVOL_TRY_ASSIGN(report, export_vtu(volume, options.output, selection, progress, options.replace));
  return with_errors({{"output", options.output},
                      {"points", report.points},
                      {"mass", report.mass},
                      {"file_bytes", report.file_bytes},
                      {"renamed", report.renamed}},
                     volume, selection);
}

// Prints by how much numbers of the output may differ from those that svbuild was given.
void print_errors(const json& report) {
  std::string errors;
  for (const auto& [name, error] : report["value_errors"].items())
    if (error > 0) errors += fmt::format(", {} {:.3g}", name, error.get<double>());
  const auto position_error = report["position_error"].get<double>();
  if (errors.empty() && !(position_error > 0))
    print_out("  positions and values as they were given\n");
  else
    print_out("  largest errors: of a coordinate {:.3g}{}\n", position_error, errors);
}

void print_streamlines(const json& report) {
  std::string ends;
  for (const auto& [end, count] : report["ends"].items())
    ends += fmt::format(", {} {}", end, count.get<std::uint64_t>());
  print_out("{}: {} streamlines of {} seeds, {} points, {} bytes, {:.2f} s\n  ends: {}\n",
            report["output"].get<std::string>(), report["lines"].get<std::uint64_t>(),
            report["seeds"].get<std::uint64_t>(), report["points"].get<std::uint64_t>(),
            report["file_bytes"].get<std::uint64_t>(), report["seconds"].get<double>(), ends.substr(2));
}

void print_text(const json& report) {
  if (report.contains("voxels"))
    print_out("{}: {} voxels of {} splats, mass {:.9g} of {:.9g}, {} bytes, {:.2f} s\n",
              report["output"].get<std::string>(), report["voxels"].get<std::uint64_t>(),
              report["splats"].get<std::uint64_t>(), report["voxel_mass"].get<double>(),
              report["splat_mass"].get<double>(), report["file_bytes"].get<std::uint64_t>(),
              report["seconds"].get<double>());
  else if (report.contains("triangles"))
    print_out("{}: {} triangles, area {:.9g}, {}, {} bytes, {:.2f} s\n", report["output"].get<std::string>(),
              report["triangles"].get<std::uint64_t>(), report["area"].get<double>(),
              report["closed"].get<bool>()
                  ? fmt::format("closed round a volume of {:.9g}", report["volume"].get<double>())
                  : std::string("open"),
              report["file_bytes"].get<std::uint64_t>(), report["seconds"].get<double>());
  else if (report.contains("rows"))
    print_out("{}: {} rows, length {:.9g}, of which {:.9g} in cells, {} bytes, {:.2f} s\n",
              report["output"].get<std::string>(), report["rows"].get<std::uint64_t>(), report["length"].get<double>(),
              report["inside"].get<double>(), report["file_bytes"].get<std::uint64_t>(),
              report["seconds"].get<double>());
  else if (report.contains("lines"))
    print_streamlines(report);
  else if (report.contains("cells"))
    print_out("{}: {} cells with {} points, volume {:.9g}, {} bytes, {:.2f} s\n", report["output"].get<std::string>(),
              report["cells"].get<std::uint64_t>(), report["points"].get<std::uint64_t>(),
              report["volume"].get<double>(), report["file_bytes"].get<std::uint64_t>(),
              report["seconds"].get<double>());
  else
    print_out("{}: {} points, mass {:.9g}, {} bytes, {:.2f} s\n", report["output"].get<std::string>(),
              report["points"].get<std::uint64_t>(), report["mass"].get<double>(),
              report["file_bytes"].get<std::uint64_t>(), report["seconds"].get<double>());
  if (const auto left_out = report.value("left_out", std::uint64_t{0}); left_out > 0)
    print_out("  {} cells are left out: this program does not know their shape\n", left_out);
  if (const auto split = report.value("split", std::uint64_t{0}); split > 0)
    print_out("  {} cells are written as the tetrahedra of the file: a reader of rounded corners would choose others\n",
              split);
  for (const auto& [usual, name] : report["renamed"].items())
    print_out("  \"{}\" is an attribute: what svexport calls so is \"{}\"\n", usual, name.get<std::string>());
  if (report.contains("value_errors")) print_errors(report);
}

Status run_export(const Options& options) {
  const double start = seconds_now();
  SPLATVOL_TRY(check_outputs({options.output}, {options.file}, options.replace));
  SPLATVOL_TRY_ASSIGN(steps, open_steps(options.file));
  SPLATVOL_TRY_ASSIGN(step, find_step(steps, options.step));
  SPLATVOL_TRY_ASSIGN(volume, steps.volume(step));
  Box box = format::SplatSelection().box;
  if (!options.box.empty())
    box = {{options.box[0], options.box[1], options.box[2]}, {options.box[3], options.box[4], options.box[5]}};
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(*volume, options.resolution, options.attributes, box));
  const auto export_it = options.is_vdb()                  ? export_voxels
                         : options.contour                 ? export_surface
                         : options.streamlines.are_given() ? export_lines_of
                         : !options.line.empty()           ? export_table
                         : options.cells                   ? export_mesh
                                                           : export_points;
  SPLATVOL_TRY_ASSIGN(report, export_it(*volume, selection, options));
  report["seconds"] = seconds_now() - start;
  if (options.progress)
    ProgressLines().print({{"result", report}});
  else if (options.json)
    fmt::print("{}\n", json_text(report, 1));
  else {
    print_text(report);
    tell_nearest(options.output, steps, options.step, step);
  }
  return {};
}

// For a program that started this one: it ends with that, and says in a line what is wrong.
Status run_for_program(const Options& options) {
  end_with_parent();
  Status done = run_export(options);
  if (!done) ProgressLines().print({{"error", done.error().message}});
  return done;
}

void add_file_options(CommandLine& app, Options& options) {
  add_file_argument(app, options.file);
  add_step_options(app, options.step);
  app.add_option(
         "-o,--output", options.output,
         "The file to write. .vdb: a grid of each attribute, and one of the share of each voxel that is material. "
         ".vtu: points with their values, and the mass, centroid and covariance of their material; for each "
         "attribute A, \"A mean\", \"A deviation\", \"A covariance\" and \"A gradient\" of its moments, and "
         "the gradient direction that svbuild --gradients stores for the point, \"A gradient direction\". An "
         "attribute keeps its name: what svexport calls so becomes \"NAME (splat)\". In .vtu and .vtp files, the three "
         "components U[0], U[1] and U[2] of a vector are one array U, without its magnitude. Positions and values are "
         "those of "
         "the input up to the errors that the result states; svbuild --exact leaves none. .vtp, .stl, .glb: the "
         "triangles "
         "of a contour; .vtp has the values of all attributes of --attribute. .csv: a table of the values along a "
         "line. .vtp and .csv: streamlines. Replaces its own exports, other files with --force only")
      ->required()
      ->type_name("OUT.vdb|OUT.vtu|OUT.vtp|OUT.stl|OUT.glb|OUT.csv")
      ->check(check_not_empty);
}

void add_selection_options(CommandLine& app, Options& options) {
  app.add_option(
         "--attribute", options.attributes,
         "An attribute to export; repeatable (default: all, by all their names). The first is that of the contour")
      ->check(check_not_empty)
      ->type_name("NAME")
      ->allow_extra_args(false);
  app.add_option("--resolution", options.resolution, "0 is the coarsest (default: the finest)")
      ->range(0, 1000)
      ->type_name("R");
  app.add_flag(
      "--cells", options.cells,
      "Write the cells of the mesh with their points and values, from a file that keeps them; for .vtu. Polyhedra are "
      "written as the tetrahedra that they are split into, and so are cells that a reader of rounded corners would "
      "split otherwise. Cells of svbuild --cells own have values themselves, and their points have none. A box takes "
      "every cell whose own bounding box meets it, as positions are stored");
  app.add_option(
         "--contour", options.contour,
         "Write the surface where the attribute has this value, in the cells of the mesh, from a file that keeps "
         "them; for .vtp, .stl and .glb. The result has its area, whether it is closed, and then the volume of "
         "the values above that it encloses")
      ->type_name("VALUE")
      ->check(check_finite);
  app.add_option(
         "--line", options.line,
         "Write the values along the line between two positions, in the cells of the mesh, from a file that keeps "
         "them; "
         "for .csv: arc length, x, y, z and the attributes, a row at each crossing from a tetrahedron of the cells to "
         "another. Values are linear between rows. Where they jump, two rows have one position. Outside of all cells, "
         "values are nan. An existing .csv is replaced with --force only: it has no room for a mark")
      ->type_name("X,Y,Z:X,Y,Z")
      ->check(check_of(parse_line));
  app.add_option("--samples", options.samples, "As many rows in equal steps instead, both ends of the line included")
      ->range(2, 100'000'000)
      ->type_name("N");
  app.add_option("--box", options.box, "Only the voxels whose centres, or the points, that lie in this box")
      ->type_name("X0,Y0,Z0,X1,Y1,Z1")
      ->delimiter(',')
      ->expected(6)
      ->check(check_finite);
  app.add_option("--voxel", options.voxel, "Edge of a voxel, in the data's units; for .vdb")
      ->type_name("SIZE")
      ->check([](const std::string& text) {
        const double number = std::strtod(text.c_str(), nullptr);
        return number > 0 && std::isfinite(number) ? std::string() : "'" + text + "' is not a size";
      });
  app.add_option(
         "--memory", options.memory,
         "Bytes that the voxels, the open vertices of a contour, or the cells that streamlines wait for may take, such "
         "as 2G (default: a quarter of the machine's or container's)")
      ->type_name("SIZE")
      ->check(check_of(parse_bytes));
  add_streamline_options(app, options.streamlines);
  add_force_option(app, options.replace);
  app.add_flag("--json", options.json, "Print the result as JSON");
  app.add_flag("--progress", options.progress, "For programs: print lines of JSON, the last with the result");
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  Options options;
  CommandLine app(
      "Exports a .svol file to voxels (.vdb, for OpenVDB), to points or cells (.vtu, for VTK), to the triangles "
      "of a contour (.vtp, .stl, .glb), to the values on a line (.csv), or to streamlines (.vtp, .csv)",
      "svexport");
  add_file_options(app, options);
  add_selection_options(app, options);
  app.callback([&] { check_usage(options); });
  return run_tool(app, argc, argv, [&] { return options.progress ? run_for_program(options) : run_export(options); });
}
