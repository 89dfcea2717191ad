// fuzz_seeds FOLDER FILE.svol...: writes inputs to begin with, one folder for each fuzzer.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "base/file.h"
#include "format/volume.h"
#include "scene/scene.h"
#include "tests/fuzz/foreign_seeds.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/memory_source.h"
#include "tests/support/sftp_answers.h"
#include "tests/support/surgery.h"
#include "tests/support/test_volume.h"

namespace splatvol::fuzz {
namespace {

using format::Bytes;

class Seeds {
 public:
  explicit Seeds(std::string folder) : folder_(std::move(folder)) {}

  Status add(std::string_view fuzzer, const Bytes& bytes) {
    const std::string folder = fmt::format("{}/{}", folder_, fuzzer);
    std::filesystem::create_directories(folder);
    return write_text_file(fmt::format("{}/{:016x}", folder, format::hash_bytes(bytes)),
                           {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  }
  Status add(std::string_view fuzzer, std::string_view text) {
    const auto raw = std::as_bytes(std::span(text));
    return add(fuzzer, Bytes(raw.begin(), raw.end()));
  }

 private:
  std::string folder_;
};

// A chunk, with what stands before it in an input of fuzz_columns.
Bytes column_seed(std::uint8_t column, const Cube& cube, const format::ChunkEntry& entry, const Bytes& payload) {
  Bytes seed;
  format::append_record(seed, column);
  format::append_record(seed, std::uint8_t{0});
  format::append_record(seed, std::uint8_t{0});
  format::append_record(seed, cube.edge);
  for (int axis = 0; axis < 3; ++axis) format::append_record(seed, double{cube.origin[axis]});
  format::append_record(seed, 1e-3 * cube.edge);
  format::append_record(seed, entry.min);
  format::append_record(seed, entry.max);
  seed.insert(seed.end(), payload.begin(), payload.end());
  return seed;
}

Status add_columns(Seeds& seeds, const format::Volume& volume) {
  const format::VolumeInfo& info = volume.info();
  const std::uint64_t rows = std::min<std::uint64_t>(volume.rows().row_count(), 8);
  for (std::uint64_t row = 0; row < rows; ++row)
    for (const int column : volume.rows().columns_of_row(row)) {
      constexpr format::ColumnKind kinds[] = {format::ColumnKind::position, format::ColumnKind::centroid,
                                              format::ColumnKind::value,    format::ColumnKind::octant,
                                              format::ColumnKind::moments,  format::ColumnKind::value_moments,
                                              format::ColumnKind::gradient};
      const auto kind = std::ranges::find(kinds, info.columns[static_cast<std::size_t>(column)].kind);
      if (kind == std::end(kinds)) continue;
      SPLATVOL_TRY_ASSIGN(page, volume.read_directory_page(volume.directory_page_of_row(row, column)));
      const format::ChunkLocation& chunk = volume.find_chunk(page, row, column);
      SPLATVOL_TRY_ASSIGN(packed, volume.read_bytes(chunk.offset, chunk.entry.packed_bytes));
      SPLATVOL_TRY_ASSIGN(payload, format::unpack(packed, chunk.entry.unpacked_bytes, "seed"));
      SPLATVOL_TRY(seeds.add("fuzz_columns", column_seed(static_cast<std::uint8_t>(kind - std::begin(kinds)), info.cube,
                                                         chunk.entry, payload)));
    }
  return {};
}

// Structures of index pages and summaries, with what stands before them in an input of fuzz_index.
Status add_index(Seeds& seeds, const test::Dissected& file, const format::VolumeInfo& info) {
  std::vector<Bytes> structures, tables, summaries;
  static_cast<void>(file.assemble(
      [&](test::Part part, std::size_t, Bytes& bytes) {
        if (part == test::Part::structure) structures.push_back(bytes);
        if (part == test::Part::index_table) tables.push_back(bytes);
        if (part == test::Part::summary) summaries.push_back(bytes);
      },
      test::Packing::raw));
  summaries.resize(std::max<std::size_t>(summaries.size(), 1));
  for (std::size_t page = 0; page < std::min<std::size_t>(structures.size(), 20); ++page) {
    const auto nodes = format::read_record<std::uint32_t>(tables[page], 0);
    Bytes seed;
    const auto append = [&](std::size_t number) { format::append_record(seed, static_cast<std::uint16_t>(number)); };
    append(info.resolutions() - 1);
    append(info.size_bounds.size());
    append(1);
    append(page + 1 == structures.size() ? 0 : 7);
    append(nodes);
    format::append_record(seed, std::uint32_t{1} << 20);
    append(structures[page].size());
    seed.insert(seed.end(), structures[page].begin(), structures[page].end());
    const Bytes& summary = summaries[std::min(page, summaries.size() - 1)];
    seed.insert(seed.end(), summary.begin(), summary.end());
    SPLATVOL_TRY(seeds.add("fuzz_index", seed));
  }
  return {};
}

// Files whose hashes are right: with occupancies that lack what is there, and with a boundary of many triangles.
Status add_lies(Seeds& seeds, const test::Dissected& file) {
  const Bytes hiding = file.assemble([](test::Part part, std::size_t, Bytes& bytes) {
    if (part != test::Part::directory_page) return;
    for (std::size_t at = sizeof(std::uint64_t); at + sizeof(format::ChunkEntry) <= bytes.size();
         at += sizeof(format::ChunkEntry)) {
      auto entry = format::read_record<format::ChunkEntry>(bytes, at);
      entry.occupancy <<= 1;
      std::memcpy(bytes.data() + at, &entry, sizeof(entry));
    }
  });
  SPLATVOL_TRY(seeds.add("fuzz_svol", hiding));
  if (file.count(test::Part::patch) == 0) return {};

  // Codes that repeat themselves, but for some: the ratio of R7 allows no more.
  static constexpr std::uint64_t points = 200, triangles = 100'000;
  const Bytes huge = file.assemble([](test::Part part, std::size_t, Bytes& bytes) {
    if (part == test::Part::patch) {
      bytes.assign(12 * (points + triangles), std::byte{0});
      const auto codes = std::span(bytes).subspan(12 * points, 3 * triangles);
      std::fill(codes.begin() + points, codes.end(), std::byte{1});
      for (std::size_t i = points; i < codes.size(); i += 300) codes[i] = static_cast<std::byte>(1 + i / 300 % points);
    }
    if (part != test::Part::metadata) return;
    auto document = nlohmann::json::parse(std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
    for (nlohmann::json& patch : document["boundary"]["patches"]) {
      patch["points"] = points;
      patch["triangles"] = triangles;
    }
    const std::string text = document.dump();
    const auto raw = std::as_bytes(std::span(text));
    bytes.assign(raw.begin(), raw.end());
  });
  return seeds.add("fuzz_svol", huge);
}

// Settings of fuzz_draw.
constexpr std::uint64_t exact = 0x4000'0100'0A10'0000, exact_from_server = 0x2001'C100'0A10'0000,
                        splats_from_server = 0x0000'4400'0A10'0300;

Status add_drawn(Seeds& seeds, const Bytes& file, std::initializer_list<std::uint64_t> all_settings) {
  for (const std::uint64_t settings : all_settings) {
    Bytes seed;
    format::append_record(seed, settings);
    seed.insert(seed.end(), file.begin(), file.end());
    SPLATVOL_TRY(seeds.add("fuzz_draw", seed));
  }
  return {};
}

Status add_volume(Seeds& seeds, const std::string& path) {
  SPLATVOL_TRY_ASSIGN(text, read_text_file(path));
  const auto raw = std::as_bytes(std::span(text));
  const auto file = test::Dissected::take_apart(raw);
  if (!file) return fail(ErrorCode::invalid_data, "{}: cannot be taken apart", path);

  // As it is, and not compressed: then single bytes mean something.
  const auto leave = [](test::Part, std::size_t, Bytes&) {};
  for (const Bytes& bytes : {Bytes(raw.begin(), raw.end()), file->assemble(leave, test::Packing::raw)}) {
    SPLATVOL_TRY(seeds.add("fuzz_svol", bytes));
    SPLATVOL_TRY(add_drawn(seeds, bytes, {0x0000'0000'0000'0000, 0x0003'0400'0310'0100, 0x0107'1400'0905'0001}));
    SPLATVOL_TRY(add_drawn(seeds, bytes, {exact, exact_from_server, splats_from_server}));
  }
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(memory_source(raw, path)));
  SPLATVOL_TRY(add_columns(seeds, *volume));
  SPLATVOL_TRY(add_lies(seeds, *file));
  SPLATVOL_TRY(add_index(seeds, *file, volume->info()));
  std::vector<std::string> metadata;
  static_cast<void>(file->assemble([&](test::Part part, std::size_t, Bytes& bytes) {
    if (part == test::Part::metadata) metadata.emplace_back(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  }));
  for (std::size_t i = 0; i < metadata.size(); ++i)
    SPLATVOL_TRY(seeds.add("fuzz_series", (i == 0 ? "m" : "s") + metadata[i]));
  return {};
}

// Files with cells: none, some, and in many chunks and pages. One is larger than what is read first: the rest of it can
// be read ahead.
Status add_cells(Seeds& seeds) {
  const auto leave = [](test::Part, std::size_t, Bytes&) {};
  for (const auto& [points, attributes, cells] :
       {std::tuple{4, 1, 1}, {40, 0, 0}, {60, 1, 30}, {200, 2, 300}, {300, 0, 400}, {600, 1, 200}}) {
    const auto count = static_cast<std::size_t>(points);
    std::vector<std::vector<double>> values(static_cast<std::size_t>(attributes), std::vector<double>(count));
    for (std::size_t a = 0; a < values.size(); ++a)
      for (std::size_t i = 0; i < count; ++i)
        values[a][i] = i % 13 == 5 ? std::nan("") : static_cast<double>((i * i + a) % 101);
    test::TestVolume volume = test::make_test_volume(test::random_points(count, 3), values,
                                                     {.node_points = 30, .position_error = 1e-5, .gradients = false});
    test::add_random_cells(volume, static_cast<std::size_t>(cells));
    test::add_random_polyhedra(volume, static_cast<std::size_t>(cells) / 8);
    const Bytes file = test::test_volume_bytes(volume);
    const auto parts = test::Dissected::take_apart(file);
    if (!parts) return fail(ErrorCode::invalid_data, "a file with cells cannot be taken apart");
    for (const Bytes& bytes : {file, parts->assemble(leave, test::Packing::raw)}) {
      SPLATVOL_TRY(seeds.add("fuzz_svol", bytes));
      if (bytes.size() > format::min_first_read_bytes)
        SPLATVOL_TRY(add_drawn(seeds, bytes, {exact_from_server, splats_from_server}));
    }
  }
  return {};
}

Status add_scenes(Seeds& seeds) {
  Scene scene;
  scene.camera.position = {1, 2, 3};
  scene.attribute = "p";
  scene.transfer_function.lo = 1;
  scene.transfer_function.hi = 1000;
  scene.transfer_function.colors = {{0, {0, 0, 1}}, {0.5, {0, 1, 0}}, {0.5, {1, 1, 0}}, {1, {1, 0, 0}}};
  scene.transfer_function.densities = {{0, 0}, {0.25, 3}, {1, 10}};
  SPLATVOL_TRY(seeds.add("fuzz_scene", scene_to_json(scene)));
  const SceneUse use{
      .file = "a.svol", .step = 3, .quality = {.max_error = 0.01}, .drawing = {.kernel = KernelKind::octant}};
  SPLATVOL_TRY(seeds.add("fuzz_scene", to_json({scene, use})));
  scene.transfer_function.axis = ValueAxis::log;
  scene.lighting = Lighting{};
  scene.clip_box = Box{{0, 0, 0}, {1, 1, 1}};
  scene.outline = true;
  scene.slices = {{.point = {1, 2, 3}, .normal = {0, 0, 1}}, {.normal = {1, -1, 2}, .opacity = 0.5, .shown = false}};
  scene.clip_planes = {{.point = {0.5, 0, 0}, .normal = {1, 1, 0}}};
  scene.opacity = SceneOpacity{"T", {.lo = 2, .hi = 9, .colors = {{0, dvec3(1)}}, .densities = {{0, 0}, {1, 1}}}};
  scene.contours = {{.values = {3, 4.5}, .color_by = SceneColoring{"T", scene.opacity->function}, .opacity = 0.5},
                    {.values = {2}, .color = dvec3(1)}};
  scene.surfaces = {{.boundary = "wall*", .color_by = scene.contours[0].color_by, .near_side = NearSide::hidden}};
  SPLATVOL_TRY(seeds.add("fuzz_scene", scene_to_json(scene)));
  scene.transfer_function.axis = ValueAxis::asinh;
  scene.transfer_function.lo = -1000;
  scene.camera.projection = Camera::Projection::orthographic;
  SPLATVOL_TRY(seeds.add("fuzz_scene", scene_to_json(scene)));

  // Settings, then bytes of control points; settings, then counts of no elements.
  SPLATVOL_TRY(seeds.add("fuzz_transfer_table", std::string(100, '\1')));
  SPLATVOL_TRY(seeds.add("fuzz_transfer_table", std::string(9000, '\5')));
  const std::string settings("\377\377\40\0\5\40", 6);  // of fuzz_sftp
  SPLATVOL_TRY(seeds.add("fuzz_sftp", settings + test::opening_answers(1000)));
  SPLATVOL_TRY(seeds.add("fuzz_sftp", settings + test::data_answer(1, std::string(1000, 'x')) +
                                          test::status_answer(2, 4, "Failure") + test::data_answer(3, "x") +
                                          test::data_answer(36, "y")));
  for (const char kind : {'\0', '\1', '\2', '\3', '\4', '\5'})
    SPLATVOL_TRY(seeds.add("fuzz_messages", kind + std::string(400, '\0')));

  Camera camera{.position = {1, 2, 3}};
  for (const char* space : {"RGB", "HSV", "Lab", "Diverging", "Step"})
    SPLATVOL_TRY(
        seeds.add("fuzz_scene", fmt::format(R"([{{"ColorSpace":"{}","RGBPoints":[0,0,0,1,1,1,0,0]}}])", space)));
  SPLATVOL_TRY(seeds.add("fuzz_scene", camera_to_json(camera)));
  const std::string from = camera_to_json(camera);
  camera.position = {3, 0, 1};
  SPLATVOL_TRY(seeds.add("fuzz_camera_path",
                         fmt::format(R"(c{{"seconds": 5, "cameras": [{}, {}]}})", from, camera_to_json(camera))));
  return seeds.add("fuzz_camera_path",
                   R"(r{"seconds":0.1,"events":[["size",800,600,800,600,1.0],["pointer",1.5,2]]}
{"seconds":0.1,"events":[["button",0,true],["scroll",0,-1.5],["key",65,true],["text",97],["drop",["a.svol"]]]}
)");
}

Status write_seeds(int count, char** arguments) {
  Seeds seeds(arguments[0]);
  for (int i = 1; i < count; ++i) SPLATVOL_TRY(add_volume(seeds, arguments[i]));
  SPLATVOL_TRY(add_cells(seeds));
  SPLATVOL_TRY(seeds.add("fuzz_series", R"(i{"steps":[{"time":0,"file":"a.svol"},{"time":1.5,"file":"b.svol"}],
"attributes":[{"name":"p","unit":"Pa","min":0,"max":1},{"name":"T","unit":"","min":null,"max":null}]})"));
  SPLATVOL_TRY(seeds.add("fuzz_series", R"(i{"steps":[{"time":0,"file":"a.svol\u0000b.svol"}],
"attributes":[{"name":"p","unit":"kPa","min":-1e300,"max":1}]})"));
  for (const auto& [fuzzer, text] : foreign_seeds()) SPLATVOL_TRY(seeds.add(fuzzer, text));
  return add_scenes(seeds);
}

}  // namespace
}  // namespace splatvol::fuzz

int main(int argc, char** argv) {
  if (argc < 2) {
    fmt::print(stderr, "usage: fuzz_seeds FOLDER FILE.svol...\n");
    return 2;
  }
  const splatvol::Status written = splatvol::fuzz::write_seeds(argc - 1, argv + 1);
  if (!written) fmt::print(stderr, "fuzz_seeds: {}\n", written.error().message);
  return written ? 0 : 1;
}
