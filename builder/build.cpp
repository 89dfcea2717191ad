#include "builder/build.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/spin_mutex.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>

#include "base/file.h"
#include "builder/mesh/boundary.h"
#include "builder/output/index_leaf_spool.h"
#include "builder/output/row_streams.h"
#include "builder/points/batches.h"
#include "builder/points/delaunay_subdomains.h"
#include "builder/reduction/reduction_pass.h"
#include "format/volume_writer.h"

namespace splatvol {
namespace {

using nlohmann::json;

constexpr std::uint64_t fitted_splats = std::uint64_t{1} << 19;

// Of scattered points that are held at once.
constexpr std::uint64_t held_point_bytes = 700;

// Vertices of meshes that are held at once: only there can merging leave fewer than what is reduced.
constexpr std::uint64_t most_held_vertices = std::uint64_t{1} << 16;

json provenance(const BuildOptions& options, const BuildReport& report) {
  const PointCensus& census = report.points;
  const CellCensus& cells = report.cells;
  return {{"builder", options.builder},
          {"inputs", options.inputs},
          {"connectivity", connectivity_name(report.connectivity)},
          {"points",
           {{"read", census.read},
            {"not_finite", census.not_finite},
            {"merged", census.merged},
            {"coincident", census.coincident},
            {"in_no_cell", census.in_no_cell},
            {"uncertain", report.uncertain}}},
          {"cells",
           {{"types", cells.cells},
            {"tetrahedra", cells.tetrahedra},
            {"inverted", cells.inverted},
            {"flat", cells.flat},
            {"without_volume", cells.without_volume},
            {"hidden", cells.hidden},
            {"non_finite", cells.non_finite},
            {"not_star_shaped", cells.not_star_shaped}}}};
}

// All but what is only known at the end: counts, missing values, provenance.
format::VolumeInfo describe(const BuildOptions& options, const Cube& cube, std::vector<format::Attribute> attributes) {
  using format::ColumnKind;
  using format::ColumnScope;
  format::VolumeInfo info;
  info.cube = cube;
  info.points_per_chunk = options.points_per_chunk;
  info.reduction_method = reduction_name(options.reduction);
  info.leaf_points = options.leaf_points;
  info.size_bounds = {"octant", "moments"};  // as IndexStream has them
  info.columns = {{ColumnKind::position, ColumnScope::segment, -1},
                  {ColumnKind::octant, ColumnScope::resolution, -1},
                  {ColumnKind::centroid, ColumnScope::resolution, -1},
                  {ColumnKind::moments, ColumnScope::resolution, -1}};
  for (std::size_t a = 0; a < attributes.size(); ++a) {
    info.columns.push_back({ColumnKind::value, ColumnScope::segment, static_cast<int>(a)});
    info.columns.push_back({ColumnKind::value_moments, ColumnScope::resolution, static_cast<int>(a)});
    info.columns.push_back({ColumnKind::gradient, ColumnScope::segment, static_cast<int>(a)});
  }
  info.attributes = std::move(attributes);
  return info;
}

// What each point of a triangulation stands for.
void add_mesh_material(const std::vector<Tetrahedron>& tetrahedra, PointBatch& points) {
  const VertexMaterial mesh(points.positions, tetrahedra);
  points.moments.resize(points.size());
  for (std::size_t a = 0; a < points.values.size(); ++a) {
    points.value_moments[a].resize(points.size());
    points.gradients[a].resize(points.size());
  }
  tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    points.moments[i] = mesh.moments(i);
    for (std::size_t a = 0; a < points.values.size(); ++a) {
      points.value_moments[a][i] = mesh.value_moments(i, points.values[a]);
      points.gradients[a][i] = mesh.gradient(i, points.values[a]);
    }
  });
  points.planes = boundary_planes(points.positions, find_outer_faces(points.positions, tetrahedra));
}

Status add_voronoi_material(PointBatch& points) {
  SPLATVOL_TRY_ASSIGN(material, ScatteredEstimate::create(points.positions));
  points.moments = material.spatial();
  for (std::size_t a = 0; a < points.values.size(); ++a) {
    points.value_moments[a] = material.values(points.values[a]);
    const std::vector<vec3> gradients = material.gradients(points.values[a]);
    points.gradients[a].assign(gradients.begin(), gradients.end());
  }
  return {};
}

struct Connection {
  Connectivity used;
  std::shared_ptr<const DelaunaySubdomains> blocks = nullptr;  // where the tetrahedra are found block by block
};

// Finds what each point stands for where no cells say it. Which way is chosen depends on the number of points and not
// on memory, as the result must not.
Result<Connection> connect(const BuildOptions& options, PointStream& points, const std::string& folder,
                           Batches& batches) {
  if (points.summary().has_material) {
    // Only then is it known how many are left once equal ones are merged, and whether these are reduced at all.
    const bool small = points.count() <= most_held_vertices;
    if (small) SPLATVOL_TRY(batches.hold_all([](PointBatch&) -> Status { return {}; }));
    return Connection{Connectivity::mesh};
  }
  if (options.connectivity == Connectivity::mesh)
    return fail(ErrorCode::invalid_data, "no cells that fill a volume: the connectivity 'mesh' needs some");
  if (points.count() > options.held_points) {
    if (options.connectivity != Connectivity::delaunay) {
      batches.estimate_material();
      return Connection{Connectivity::none};
    }
    SPLATVOL_TRY_ASSIGN(created, DelaunaySubdomains::create(points, options.memory / 2, folder));
    const auto blocks = std::make_shared<DelaunaySubdomains>(std::move(created));
    batches.read_from([blocks](PointBatch& batch) { return blocks->next(batch); });
    return Connection{Connectivity::delaunay, blocks};
  }
  const std::uint64_t needed = points.count() * held_point_bytes;
  if (needed > options.memory && points.count() > most_held_vertices)
    return fail(ErrorCode::out_of_budget,
                "to join {} scattered points takes about {} bytes of memory, and {} may be held: grant more",
                points.count(), needed, options.memory);
  Connectivity used = Connectivity::none;
  SPLATVOL_TRY(batches.hold_all([&](PointBatch& all) -> Status {
    if (options.connectivity == Connectivity::none) return add_voronoi_material(all);
    SPLATVOL_TRY_ASSIGN(tetrahedra, delaunay_tetrahedra(all.positions));
    if (tetrahedra.empty() && options.connectivity == Connectivity::automatic) return add_voronoi_material(all);
    used = Connectivity::delaunay;
    add_mesh_material(tetrahedra, all);
    return {};
  }));
  return Connection{used};
}

// Runs all points through the pass: batches are read, taken and written in order, what lies between does not depend on
// order.
Status reduce(Batches& batches, ReductionPass& pass, RowStreams& rows, std::uint64_t points, std::size_t attributes,
              const BuildProgress& progress) {
  struct Item {
    PointBatch batch;
    ReducedBatch reduced;
    std::vector<RowStreams::Chunk> chunks;
  };
  constexpr std::size_t items_in_flight = 8;
  std::vector<std::unique_ptr<Item>> spare;  // the last used, whose memory is still in a cache, first
  tbb::spin_mutex spare_mutex;
  for (std::size_t i = 0; i < items_in_flight; ++i)
    spare.push_back(std::make_unique<Item>(Item{{}, ReducedBatch(attributes), {}}));
  const auto take_spare = [&] {
    const tbb::spin_mutex::scoped_lock lock(spare_mutex);
    Item* item = spare.back().release();
    spare.pop_back();
    return item;
  };
  const auto give_back = [&](Item* item) {
    const tbb::spin_mutex::scoped_lock lock(spare_mutex);
    spare.emplace_back(item);
  };
  Status read, taken, written;
  std::atomic<bool> failed = false;
  tbb::parallel_pipeline(
      items_in_flight,
      tbb::make_filter<void, Item*>(tbb::filter_mode::serial_in_order, [&](tbb::flow_control& control) -> Item* {
        Item* item = take_spare();
        const auto more = batches.next(item->batch);
        if (!more) read = tl::unexpected(more.error());
        if (more && *more && !failed) {
          pass.prepare(item->batch, item->reduced);
          return item;
        }
        give_back(item);
        control.stop();
        return nullptr;
      }) & tbb::make_filter<Item*, Item*>(tbb::filter_mode::parallel, [&](Item* item) {
        batches.estimate(item->batch);
        pass.reduce(item->batch, item->reduced);
        return item;
      }) & tbb::make_filter<Item*, Item*>(tbb::filter_mode::serial_in_order, [&](Item* item) {
        if (failed) return item;
        const PointBatch& batch = item->batch;
        taken = pass.take(batch, item->reduced);
        if (!taken) failed = true;
        rows.take_complete(item->chunks);
        progress("reducing", static_cast<double>(batch.first + batch.size()) / static_cast<double>(points));
        return item;
      }) & tbb::make_filter<Item*, Item*>(tbb::filter_mode::parallel, [&](Item* item) {
        if (!failed)
          for (RowStreams::Chunk& chunk : item->chunks) rows.pack(chunk);
        return item;
      }) & tbb::make_filter<Item*, void>(tbb::filter_mode::serial_in_order, [&](Item* item) {
        for (auto chunk = item->chunks.begin(); chunk != item->chunks.end() && !failed; ++chunk) {
          written = rows.write(*chunk);
          if (!written) failed = true;
        }
        give_back(item);
      }));
  SPLATVOL_TRY(read);
  SPLATVOL_TRY(taken);
  SPLATVOL_TRY(written);
  return pass.finish();
}

Result<format::PackedIndex> pack_index(IndexLeafSpool& leaves, const ReductionPass& pass, const Cube& cube,
                                       std::size_t resolutions, std::size_t attributes, const std::string& folder) {
  SPLATVOL_TRY_ASSIGN(pages, TempFile::create(folder));
  IndexStream index(cube, resolutions, attributes,
                    [&](const format::PackedIndexPage& page) { return pages.append(page.bytes); });
  SPLATVOL_TRY(
      leaves.read(resolutions, pass.late_leaves(), [&](IndexLeaf leaf) { return index.add(std::move(leaf)); }));
  SPLATVOL_TRY_ASSIGN(root, index.finish());
  return format::PackedIndex{IndexStream::shape(resolutions, attributes), std::move(root), std::move(pages)};
}

}  // namespace

const char* connectivity_name(Connectivity connectivity) {
  switch (connectivity) {
    case Connectivity::mesh:
      return "mesh";
    case Connectivity::delaunay:
      return "delaunay";
    case Connectivity::none:
      return "none";
    default:
      return "auto";
  }
}

Result<BuildReport> build_volume(Source& source, const std::string& output, const BuildOptions& options,
                                 const BuildProgress& progress) {
  if (options.leaf_points < 8)
    return fail(ErrorCode::invalid_argument,
                "a leaf must be allowed 8 points or more: with {}, a cell could be split without losing any",
                options.leaf_points);
  // What cannot be written is better known before the work.
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(output));
  const bool use_cells = options.connectivity == Connectivity::automatic || options.connectivity == Connectivity::mesh;
  // Where there will be room for the file there is room for parts of it.
  const std::string folder = options.temp_folder.empty() ? folder_of(output) : options.temp_folder;
  SPLATVOL_TRY_ASSIGN(points, PointStream::create(source, use_cells, options.memory / 2, folder,
                                                  [&](double fraction) { progress("reading", fraction); }));
  Batches batches(points, std::max<std::uint64_t>({options.index_leaf_points, options.leaf_points, 255}));
  progress("connecting", 0);
  SPLATVOL_TRY_ASSIGN(connection, connect(options, points, folder, batches));

  const InputSummary& input = points.summary();
  format::VolumeInfo info = describe(options, input.cube, input.attributes);
  SPLATVOL_TRY_ASSIGN(leaf_file, TempFile::create(folder));
  const bool fits = batches.count() <= fitted_splats;
  RowStreams rows(info, fits, folder, file);
  IndexLeafSpool leaves(std::move(leaf_file));
  std::vector<double> offsets;
  for (const format::Attribute& attribute : input.attributes) offsets.push_back(attribute.offset);
  ReductionSettings settings{input.cube, options.leaf_points, batches.count() > coarsest_target,
                             fits,       input.attributes,    offsets};
  if (!fits) settings.pack = [&rows](const SplatRows& chunk) { return rows.pack_finest(chunk); };
  settings.points_per_chunk = options.points_per_chunk;
  settings.method = options.reduction;
  ReductionPass pass(settings, rows, [&](const OpenIndexLeaf& leaf) { return leaves.append(leaf); });
  SPLATVOL_TRY(reduce(batches, pass, rows, points.count(), input.attributes.size(), progress));

  const std::vector<std::uint64_t> counts = pass.counts();
  progress("fitting densities", 0);
  SPLATVOL_TRY(rows.finish(counts.size()));
  progress("indexing", 0);
  SPLATVOL_TRY_ASSIGN(index, pack_index(leaves, pass, input.cube, counts.size(), input.attributes.size(), folder));

  info.resolution_counts.assign(counts.rbegin(), counts.rend());
  for (std::size_t a = 0; a < input.attributes.size(); ++a) info.attributes[a].missing = pass.missing()[a];
  BuildReport report{.resolution_counts = info.resolution_counts,
                     .connectivity = connection.used,
                     .points = input.census,
                     .cells = input.cells,
                     .uncertain = connection.blocks ? connection.blocks->uncertain() : 0};
  info.provenance = provenance(options, report).dump(-1, ' ', false, json::error_handler_t::replace);
  SPLATVOL_TRY_ASSIGN(
      writer, format::VolumeWriter::create(std::move(file), rows.coarse_bytes(), info, std::move(index), folder));
  std::uint64_t row = 0;
  SPLATVOL_TRY(rows.read([&](std::span<const format::ChunkEntry> entries, std::span<const std::byte> bytes) -> Status {
    progress("writing", static_cast<double>(++row) / static_cast<double>(writer->rows().row_count()));
    return bytes.empty() ? writer->add_written_row(entries) : writer->append_row(entries, bytes);
  }));
  SPLATVOL_TRY(writer->finish(pass.histograms()));

  report.file_bytes = writer->file_bytes();
  for (const format::Attribute& attribute : info.attributes)
    report.missing.emplace_back(attribute.name, attribute.missing);
  return report;
}

}  // namespace splatvol
