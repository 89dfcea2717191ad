// svinfo: shows the contents of a .svol file.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/json.h"
#include "format/cell_reader.h"
#include "format/mesh_box.h"
#include "format/volume.h"
#include "pictures/ticks.h"
#include "streamer/first/default_scene.h"
#include "tools/steps.h"
#include "tools/svinfo_integrals.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

using format::Volume;
using json = nlohmann::ordered_json;

struct Options {
  std::string file;
  std::string scene;
  std::vector<std::string> attributes;
  IntegralOptions integrals;
  StepChoice step;
  bool json = false;
  bool verify = false;
};

struct ColumnBytes {
  std::uint64_t chunks = 0;
  std::uint64_t packed = 0;
  std::uint64_t unpacked = 0;
};

struct IndexSize {
  std::uint64_t nodes = 0;
  std::uint64_t bytes = 0;
  std::uint64_t structure_bytes = 0;  // without the attributes' ranges and occupancies
};

struct Survey {
  std::vector<ColumnBytes> columns;
  IndexSize index;
  format::Histograms histograms;
  std::unique_ptr<const format::CellReader> cells;  // null: the file keeps none
  Box box;                                          // round the mesh
  bool verified = false;
};

const char* name_of(format::SectionKind kind) {
  constexpr std::array names = {"metadata",        "index_root", "directory_root", "rows",          "index_pages",
                                "directory_pages", "histograms", "padding",        "summary_table", "boundary",
                                "unknown",         "unknown",    "cells",          "cell_summaries"};
  static_assert(names.size() == static_cast<std::size_t>(format::SectionKind::cell_summaries));
  const auto number = static_cast<std::size_t>(kind);  // from 1 on
  return number >= 1 && number <= names.size() ? names[number - 1] : "unknown";
}

// Bytes of the file's section of a kind; of a series, without its steps.
std::uint64_t section_bytes(const Volume& volume, format::SectionKind kind) {
  return std::ranges::find(volume.sections(), kind, &format::SectionEntry::kind)->packed_bytes;
}

// Bytes of the step's section of a kind; 0 if the file is no series.
std::uint64_t step_section_bytes(const Volume& volume, format::SectionKind kind) {
  const std::vector<format::SectionEntry> sections = volume.step_sections();
  const auto found = std::ranges::find(sections, kind, &format::SectionEntry::kind);
  return found == sections.end() ? 0 : found->packed_bytes;
}

Result<std::vector<ColumnBytes>> survey_columns(const Volume& volume) {
  std::vector<ColumnBytes> columns(volume.info().columns.size());
  for (std::uint64_t number = 0; number < volume.directory_page_count(); ++number) {
    SPLATVOL_TRY_ASSIGN(page, volume.read_directory_page(number));
    auto chunk = page.chunks.begin();
    for (std::uint64_t row = page.first_row; row < volume.end_row(page); ++row)
      for (const int column : volume.columns_of_row(page, row)) {
        ColumnBytes& bytes = columns[static_cast<std::size_t>(column)];
        ++bytes.chunks;
        bytes.packed += chunk->entry.packed_bytes;
        bytes.unpacked += (chunk++)->entry.unpacked_bytes;
      }
  }
  return columns;
}

Result<IndexSize> survey_index(const Volume& volume) {
  const std::uint64_t page_bytes = section_bytes(volume, format::SectionKind::index_pages);
  const format::SectionEntry& root_section =
      *std::ranges::find(volume.sections(), format::SectionKind::index_root, &format::SectionEntry::kind);
  IndexSize size{0, root_section.packed_bytes + page_bytes, root_section.unpacked_bytes};
  std::uint64_t seen_bytes = 0;
  std::vector<format::IndexPage> pages;
  SPLATVOL_TRY_ASSIGN(root, volume.read_index_root({}));
  pages.push_back(std::move(root));
  while (!pages.empty()) {
    const format::IndexPage page = std::move(pages.back());
    pages.pop_back();
    size.nodes += page.nodes.size();
    for (std::size_t node = 0; node < page.nodes.size(); ++node) {
      if (page.links[node] == format::IndexPage::no_node) continue;
      const format::IndexPageRef& ref = page.pages[page.links[node]];
      if ((seen_bytes += ref.page_bytes) > page_bytes)
        return fail(ErrorCode::invalid_data, "{}: index pages do not tile their section [R16]", volume.name());
      size.structure_bytes += ref.front_bytes;
      SPLATVOL_TRY_ASSIGN(child,
                          volume.read_index_page(ref, page.nodes.child_masks[node], page.nodes.counts_of(node), {}));
      pages.push_back(std::move(child));
    }
  }
  return size;
}

double per(std::uint64_t bytes, std::uint64_t things) {
  return static_cast<double>(bytes) / static_cast<double>(things);
}

std::string readable_bytes(std::uint64_t bytes) {
  double number = static_cast<double>(bytes);
  int unit = 0;
  for (; number >= 1024 && unit < 4; ++unit) number /= 1024;
  constexpr const char* units[] = {"bytes", "KiB", "MiB", "GiB", "TiB"};
  return fmt::format(fmt::runtime(unit == 0 ? "{:.0f} {}" : "{:.1f} {}"), number, units[unit]);
}

json attributes_json(const format::VolumeInfo& info, const Survey& survey) {
  json list = json::array();
  for (std::size_t a = 0; a < info.attributes.size(); ++a) {
    const format::Attribute& attribute = info.attributes[a];
    json entry = {{"name", attribute.name},       {"unit", attribute.unit},  {"offset", attribute.offset},
                  {"scale", attribute.scale},     {"min", attribute.min},    {"max", attribute.max},
                  {"missing", attribute.missing}, {"error", attribute.error}};
    if (!survey.histograms.empty()) entry["histogram"] = survey.histograms[a];
    list.push_back(std::move(entry));
  }
  return list;
}

json columns_json(const format::VolumeInfo& info, const Survey& survey) {
  json list = json::array();
  for (std::size_t c = 0; c < info.columns.size(); ++c) {
    const format::Column& column = info.columns[c];
    const ColumnBytes& bytes = survey.columns[c];
    json entry = {{"kind", format::column_kind_name(column.kind)},
                  {"scope", column.scope == format::ColumnScope::segment ? "segment" : "resolution"}};
    if (column.attribute >= 0) entry["attribute"] = info.attributes[static_cast<std::size_t>(column.attribute)].name;
    entry.update({{"chunks", bytes.chunks},
                  {"packed_bytes", bytes.packed},
                  {"unpacked_bytes", bytes.unpacked},
                  {"bytes_per_point", per(bytes.packed, info.point_count())}});
    list.push_back(std::move(entry));
  }
  return list;
}

// The steps of a series, the number of the one that is shown, and ranges over all steps.
json series_json(const Volume& volume, const format::Steps& steps, std::size_t shown) {
  json list = json::array(), ranges = json::array();
  for (std::size_t step = 0; step < steps.times().size(); ++step) {
    list.push_back({{"time", steps.times()[step]}});
    if (!volume.series()) continue;
    list.back()["offset"] = volume.series()->steps[step].offset;
    list.back()["bytes"] = volume.series()->steps[step].bytes;
  }
  for (const format::Attribute& attribute : volume.info().attributes) {
    const format::StepRange range = steps.range_of(attribute.name);
    ranges.push_back({{"name", attribute.name}, {"min", range.min}, {"max", range.max}});
  }
  return {{"step", shown}, {"time", steps.times()[shown]}, {"steps", list}, {"attributes", ranges}};
}

json boundary_json(const format::BoundaryInfo& boundary) {
  json patches = json::array();
  for (const format::PatchInfo& patch : boundary.patches)
    patches.push_back({{"name", patch.name},
                       {"points", patch.points},
                       {"triangles", patch.triangles},
                       {"two_sided", patch.two_sided}});
  return {{"error", boundary.error}, {"patches", patches}};
}

// The bytes of a section of cells by its parts, and in all.
std::vector<std::pair<const char*, std::uint64_t>> bytes_of(const format::CellReader& cells) {
  const std::uint64_t all = cells.section_bytes(), directory = cells.directory_bytes();
  const std::uint64_t ranks = cells.rank_bytes(), vertices = cells.vertex_bytes();
  return {{"chunks", all - directory - ranks - vertices},
          {"directory", directory},
          {"ranks", ranks},
          {"vertices", vertices},
          {"all", all}};
}

std::uint64_t cell_count(const format::CellReader& cells) {
  std::uint64_t count = 0;
  for (const format::CellKind& kind : cells.kinds()) count += kind.cells;
  return count;
}

json cells_json(const format::CellReader& cells, const format::CellsInfo& info) {
  json kinds = json::array();
  for (const format::CellKind& kind : cells.kinds())
    kinds.push_back({{"shape", format::cell_shape_name(kind.shape)},
                     {"field", format::cell_field_name(kind.field)},
                     {"known", format::is_known(kind.shape, kind.field)},
                     {"cells", kind.cells},
                     {"bytes", kind.packed_bytes},
                     {"turned", kind.turned}});
  json bytes;
  for (const auto& [part, count] : bytes_of(cells)) bytes[part] = count;
  json document = {{"cells", cell_count(cells)}, {"chunks", cells.chunk_count()}, {"kinds", kinds}, {"bytes", bytes}};
  if (info.blocks_apart) document["blocks_apart"] = true;
  return document;
}

json to_json(const Volume& volume, const format::Steps& steps, std::size_t step, const Survey& survey) {
  const format::VolumeInfo& info = volume.info();
  json document;
  document["file"] = volume.name();
  document["bytes"] = volume.file_bytes();
  document["preamble_bytes"] = volume.preamble_bytes();
  document["points"] = info.point_count();
  document["bytes_per_point"] = per(volume.file_bytes(), info.point_count());
  document["resolution_counts"] = info.resolution_counts;
  document["bounds"] = {{"low", {survey.box.low.x, survey.box.low.y, survey.box.low.z}},
                        {"high", {survey.box.high.x, survey.box.high.y, survey.box.high.z}}};
  document["cube"] = {{"origin", {info.cube.origin.x, info.cube.origin.y, info.cube.origin.z}},
                      {"edge", info.cube.edge}};
  document["points_per_chunk"] = info.points_per_chunk;
  document["reduction"] = {{"method", info.reduction_method}, {"leaf_points", info.leaf_points}};
  document["position_error"] = info.position_error;
  document["attributes"] = attributes_json(info, survey);
  for (const format::Alias& alias : info.aliases)
    document["aliases"].push_back(
        {{"name", alias.name}, {"same_as", info.attributes[static_cast<std::size_t>(alias.attribute)].name}});
  document["columns"] = columns_json(info, survey);
  document["index"] = {
      {"nodes", survey.index.nodes}, {"bytes", survey.index.bytes}, {"structure_bytes", survey.index.structure_bytes}};
  document["sections"] = json::array();
  for (const format::SectionEntry& section : volume.sections())
    document["sections"].push_back(
        {{"kind", name_of(section.kind)}, {"offset", section.offset}, {"bytes", section.packed_bytes}});
  if (info.boundary) document["boundary"] = boundary_json(*info.boundary);
  if (survey.cells) document["cells"] = cells_json(*survey.cells, info.cells.value_or(format::CellsInfo{}));
  if (info.up >= 0) document["up"] = std::string(1, "xyz"[info.up]);
  document["provenance"] = parse_ordered_json(info.provenance);
  if (!steps.times().empty()) document["series"] = series_json(volume, steps, step);
  if (survey.verified) document["verified"] = true;
  return document;
}

void print_attributes(const Volume& volume, const Survey& survey) {
  const format::VolumeInfo& info = volume.info();
  print_out("\n{:<24} {:>13} {:>13} {:>10} {:>10} {:>12}  {}\n", "attribute", "min", "max", "error", "missing",
            "bytes/point", "unit");
  for (std::size_t a = 0; a < info.attributes.size(); ++a) {
    const format::Attribute& attribute = info.attributes[a];
    std::uint64_t bytes = 0;
    for (std::size_t c = 0; c < info.columns.size(); ++c)
      if (info.columns[c].attribute == static_cast<int>(a)) bytes += survey.columns[c].packed;
    const int digits = std::max(digits_of_range(attribute.min, attribute.max), 6);
    print_out("{:<24} {:>13.{}g} {:>13.{}g} {:>10.3g} {:>10} {:>12.2f}  {}\n", attribute.name, attribute.min, digits,
              attribute.max, digits, attribute.error, attribute.missing, per(bytes, info.point_count()),
              attribute.unit);
  }
  for (const format::Alias& alias : info.aliases)
    print_out("{:<24} the same as {}\n", alias.name, info.attributes[static_cast<std::size_t>(alias.attribute)].name);
}

void print_boundary(const Volume& volume) {
  const auto& boundary = volume.info().boundary;
  if (!boundary) return;
  print_out("\n{:<24} {:>13}   boundary within {:.3g}, {}\n", "patch", "triangles", boundary->error,
            readable_bytes(section_bytes(volume, format::SectionKind::boundary)));
  for (const format::PatchInfo& patch : boundary->patches) print_out("{:<24} {:>13}\n", patch.name, patch.triangles);
}

// Prints the kinds of cells, and the bytes of the parts of their section.
void print_cells(const format::CellReader& cells) {
  print_out("\n{:<24} {:>13} {:>13} {:>13}\n", "cells", "count", "bytes/cell", "turned");
  for (const format::CellKind& kind : cells.kinds()) {
    std::string name = format::cell_shape_name(kind.shape);
    if (kind.field != format::CellField::corners) name += ", " + format::cell_field_name(kind.field);
    print_out("{:<24} {:>13} {:>13.2f} {:>13}{}\n", name, kind.cells, per(kind.packed_bytes, kind.cells), kind.turned,
              format::is_known(kind.shape, kind.field) ? "" : "  not known to this program");
  }
  const std::uint64_t count = std::max<std::uint64_t>(cell_count(cells), 1);
  print_out("\n{:<24} {:>13} {:>13}\n", "part of the cells", "bytes", "bytes/cell");
  for (const auto& [part, bytes] : bytes_of(cells))
    print_out("{:<24} {:>13} {:>13.2f}\n", part, bytes, per(bytes, count));
}

// Prints the bytes of each kind of column, of all attributes together, and of the index and the directory.
void print_bytes(const Volume& volume, const Survey& survey) {
  const format::VolumeInfo& info = volume.info();
  std::vector<std::pair<std::string, std::uint64_t>> kinds;
  for (std::size_t c = 0; c < info.columns.size(); ++c) {
    const std::string name = format::column_kind_name(info.columns[c].kind);
    auto kind = std::ranges::find(kinds, name, &std::pair<std::string, std::uint64_t>::first);
    if (kind == kinds.end()) kind = kinds.insert(kinds.end(), {name, 0});
    kind->second += survey.columns[c].packed;
  }
  const std::uint64_t directory = section_bytes(volume, format::SectionKind::directory_root) +
                                  section_bytes(volume, format::SectionKind::directory_pages);
  kinds.emplace_back("index", survey.index.bytes);
  kinds.emplace_back("directory", directory);
  if (survey.cells) kinds.emplace_back("cells", survey.cells->section_bytes());
  if (volume.series()) {
    kinds.emplace_back("summaries", step_section_bytes(volume, format::SectionKind::index_root) +
                                        step_section_bytes(volume, format::SectionKind::index_pages) +
                                        step_section_bytes(volume, format::SectionKind::summary_table));
    kinds.emplace_back("directory (step)", step_section_bytes(volume, format::SectionKind::directory_root) +
                                               step_section_bytes(volume, format::SectionKind::directory_pages));
  }
  print_out("\n{:<24} {:>13} {:>13}\n", "part", "bytes", "bytes/point");
  for (const auto& [name, bytes] : kinds)
    print_out("{:<24} {:>13} {:>13.2f}\n", name, bytes, per(bytes, info.point_count()));
}

// Prints a line such as "census.types.tetrahedron 1200" for each entry that is neither zero nor null.
void print_provenance(const json& value, const std::string& path) {
  if (value.is_structured()) {
    for (const auto& [key, child] : value.items()) {
      const std::string nested = path.empty() ? key : fmt::format("{}.{}", path, key);
      print_provenance(child, value.is_array() && !path.empty() ? path : nested);
    }
    return;
  }
  if (value == 0 || value.is_null()) return;
  fmt::print("{:<24} {}\n", path, value.is_string() ? value.get<std::string>() : json_text(value));
}

// Prints a line for each step of a series, and marks the one whose values are shown.
void print_steps(const Volume& volume, const format::Steps& steps, std::size_t shown) {
  if (steps.times().empty()) return;
  print_out("\n{:<24} {:>13} {:>13}\n", "all steps", "min", "max");
  for (const format::Attribute& attribute : volume.info().attributes) {
    const format::StepRange range = steps.range_of(attribute.name);
    const int digits = std::max(digits_of_range(range.min, range.max), 6);
    print_out("{:<24} {:>13.{}g} {:>13.{}g}\n", attribute.name, range.min, digits, range.max, digits);
  }
  print_out("\n{:<24} {:>13} {:>13}\n", "step", "time", volume.series() ? "bytes" : "");
  for (std::size_t step = 0; step < steps.times().size(); ++step) {
    const std::string bytes = volume.series() ? fmt::format("{}", volume.series()->steps[step].bytes) : "";
    print_out("{:<24} {:>13.6g} {:>13}{}\n", step, steps.times()[step], bytes, step == shown ? "  shown here" : "");
  }
}

void print_text(const Volume& volume, const format::Steps& steps, std::size_t step, const Survey& survey) {
  const format::VolumeInfo& info = volume.info();
  print_out("{}: {} points, {} ({:.1f} bytes a point)\n", volume.name(), info.point_count(),
            readable_bytes(volume.file_bytes()), per(volume.file_bytes(), info.point_count()));
  print_out("{:<24} {} ({})\n", "resolutions", info.resolutions(), fmt::join(info.resolution_counts, ", "));
  const auto& [low, high] = survey.box;
  print_out("{:<24} ({:.6g}, {:.6g}, {:.6g}) to ({:.6g}, {:.6g}, {:.6g})\n", "bounds", low.x, low.y, low.z, high.x,
            high.y, high.z);
  print_out("{:<24} {:.3g} of a coordinate\n", "largest error", info.position_error);
  if (info.up >= 0) print_out("{:<24} {}\n", "up", "xyz"[info.up]);
  print_out("{:<24} {}\n", "preamble", readable_bytes(volume.preamble_bytes()));
  print_out("{:<24} {} nodes, {:.1f} bytes a node ({:.1f} without attributes)\n", "index", survey.index.nodes,
            per(survey.index.bytes, survey.index.nodes), per(survey.index.structure_bytes, survey.index.nodes));
  print_out("{:<24} {}, at most {} points in a leaf\n", "reduction", info.reduction_method, info.leaf_points);
  print_attributes(volume, survey);
  print_boundary(volume);
  if (survey.cells) print_cells(*survey.cells);
  print_bytes(volume, survey);
  print_steps(volume, steps, step);
  print_out("\n");
  print_provenance(parse_ordered_json(info.provenance), "");
  if (survey.verified) print_out("\nevery byte checked\n");
}

Status write_scene(const Volume& volume, const Options& options) {
  SPLATVOL_TRY(check_outputs({options.scene}, {options.file}));
  SPLATVOL_TRY_ASSIGN(scene, default_scene(volume, options.attributes.empty() ? "" : options.attributes[0]));
  return write_text_file(options.scene, scene_to_json(scene));
}

Status verify(const format::Steps& steps) {
  ProgressBar bar("verifying");
  return steps.verify([&](double share) { bar.update(share); }, std::thread::hardware_concurrency());
}

Status show(const Options& options) {
  SPLATVOL_TRY_ASSIGN(steps, open_steps(options.file));
  SPLATVOL_TRY_ASSIGN(step, find_step(steps, options.step));
  SPLATVOL_TRY_ASSIGN(volume, steps.volume(step));
  Survey survey;
  if (options.verify) {
    SPLATVOL_TRY(verify(steps));
    survey.verified = true;
  }
  if (!options.scene.empty()) return write_scene(*volume, options);
  if (options.integrals.integrate) {
    SPLATVOL_TRY(print_integrals(*volume, options.integrals, options.attributes, options.json));
    if (!options.json) tell_nearest(options.file, steps, options.step, step);
    return {};
  }

  SPLATVOL_TRY_ASSIGN(columns, survey_columns(*volume));
  SPLATVOL_TRY_ASSIGN(index, survey_index(*volume));
  SPLATVOL_TRY_ASSIGN(histograms, volume->read_histograms());
  SPLATVOL_TRY_SET(survey.cells, format::CellReader::open(*volume));
  SPLATVOL_TRY_SET(survey.box, format::mesh_box(*volume));
  survey.columns = std::move(columns);
  survey.index = index;
  survey.histograms = std::move(histograms);
  if (options.json)
    fmt::print("{}\n", json_text(to_json(*volume, steps, step, survey), 1));
  else {
    print_text(*volume, steps, step, survey);
    tell_nearest(options.file, steps, options.step, step);
  }
  return {};
}

// Checks the options against each other: CLI11 sees only one option at a time.
void check_usage(const Options& options) {
  if (!options.attributes.empty() && options.scene.empty() && !options.integrals.integrate)
    wrong_option("--attribute", "is for --scene and --integrate");
  if (options.attributes.size() > 1 && !options.scene.empty()) wrong_option("--attribute", "a scene shows one");
  check_integral_options(options.integrals);
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  splatvol::Options options;
  splatvol::CommandLine app("Shows the contents of a .svol file", "svinfo");
  splatvol::add_file_argument(app, options.file);
  splatvol::add_step_options(app, options.step);
  app.add_flag("--json", options.json, "Print JSON, with histograms");
  app.add_flag("--verify", options.verify, "Read and check every byte first; of an index, of the files of all steps");
  auto* scene = app.add_option("--scene", options.scene, "Write a scene that shows the data, and print nothing")
                    ->check(splatvol::check_json_path)
                    ->type_name("OUT.json");
  app.add_option(
         "--attribute", options.attributes,
         "The scene's attribute (default: a magnitude or pressure, else the first quantity), or one to integrate "
         "(default: all); repeatable for --integrate")
      ->type_name("NAME")
      ->allow_extra_args(false);
  splatvol::add_integral_options(app, options.integrals);
  app.get_option("--integrate")->excludes(scene);
  app.callback([&] { splatvol::check_usage(options); });
  return splatvol::run_tool(app, argc, argv, [&] { return splatvol::show(options); });
}
