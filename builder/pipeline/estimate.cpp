#include "builder/pipeline/estimate.h"

#include <algorithm>
#include <cmath>

#include "base/interruption.h"
#include "builder/pipeline/connect.h"
#include "builder/pipeline/memory_plan.h"
#include "builder/points/point_records.h"
#include "builder/sorting/morton.h"

namespace splatvol {
namespace {

constexpr double kibi = 1024, mebi = kibi * kibi;

// The cost of kept cells, for each of their tetrahedra. A hexahedron has six, a polyhedron of 14 faces 34.
constexpr Range bytes_of_kept_tetrahedron{.6, 3.2};
constexpr Range microseconds_of_kept_tetrahedron{.15, 1.2};
constexpr double spooled_tetrahedron_bytes = 45;  // on the way to the file, at most
constexpr double tetrahedra_of_a_point = 6.8;     // Delaunay: 6.77 of random points without a hull

Range operator+(const Range& a, const Range& b) { return {a.low + b.low, a.high + b.high}; }
Range operator*(double factor, const Range& a) { return {factor * a.low, factor * a.high}; }

// Bytes of a piece in the builder, with what finds its material: as PieceReader counts them.
std::uint64_t bytes_of_piece(std::uint64_t points, std::uint64_t tetrahedra, std::size_t attributes) {
  return points * (sizeof(dvec3) + sizeof(std::uint32_t) + attributes * sizeof(double)) +
         tetrahedra * sizeof(Tetrahedron) + VertexMaterial::bytes(points, tetrahedra);
}

std::uint64_t bytes_of_piece(const Piece& piece, std::size_t attributes) {
  std::uint64_t bytes = bytes_of_piece(piece.points.size(), piece.tetrahedra.size(), attributes);
  if (piece.cells) bytes += bytes_of_piece(piece.cells->corners.size(), piece.cells->tetrahedra.size(), 0);
  if (piece.material)
    bytes += piece.points.size() *
             (sizeof(SpatialMoments) + sizeof(BoundaryPlane) + attributes * (sizeof(ValueMoments) + sizeof(dvec3)));
  return bytes;
}

std::uint64_t tetrahedra_of(const Piece& piece) {
  return piece.tetrahedra.size() + (piece.cells ? piece.cells->tetrahedra.size() : 0);
}

PointRecords records_of(const InputSize& size, const BuildOptions& options, std::size_t attributes) {
  return {attributes, size.single_precision, size.has_material, size.has_planes, options.gradients};
}

// Bytes of a point in the file: its geometry, which all steps share, and each of its values.
struct FileBytes {
  Range geometry, value;
};
FileBytes file_bytes_of(const InputSize& size, const BuildOptions& options) {
  // The points of a lattice take little, those of a mesh round a body as much as scattered ones.
  FileBytes bytes{size.has_material ? Range{6, 31} : Range{21, 31}, {4.2, 8.5}};
  if (options.exact.positions) bytes.geometry.high += size.single_precision ? 8 : 18;
  if (options.exact.values) bytes.value = bytes.value + Range{0, 3};
  if (options.gradients) bytes.value = bytes.value + Range{2, 4};
  if (options.reduction != Reduction::octree)
    bytes = {0.82 * bytes.geometry, {0.82 * bytes.value.low, bytes.value.high}};
  return bytes;
}

// Processor time, in microseconds: for each point, for each value and for each tetrahedron. It includes reading.
struct Work {
  Range point, value, tetrahedron;
};
Work work_of(const InputSize& size, const BuildOptions& options, Connectivity connectivity) {
  switch (connectivity) {
    case Connectivity::mesh:
      return {{1, 2.5}, {.3, .9}, {.2, .6}};
    case Connectivity::boxes:
      return {{.7, 1.4}, {.25, .6}, {}};
    case Connectivity::delaunay:
      // Triangulations of few points at a time wait for each other.
      return {size.points <= options.held_points ? Range{10, 18} : Range{18, 32}, {.3, .9}, {}};
    default:
      return {{7, 12}, {.3, .9}, {}};
  }
}

// Seconds of some microseconds of work on so many threads: a tenth is done by one of them.
double seconds_of(double microseconds, unsigned threads) {
  constexpr double alone = .1;
  return microseconds * 1e-6 * (alone + (1 - alone) / threads);
}

// Bytes that a point takes while it is sorted.
std::uint64_t sorted_bytes(const PointRecords& records) { return records.bytes() + sizeof(MortonKey); }

// Most bytes in temporary files before the first point is reduced. About as ExternalSorter::temp_bytes, whose sorter
// would take the memory of a build.
double temporary_bytes(const InputSize& size, const BuildOptions& options, const PointRecords& records) {
  constexpr double key = sizeof(std::uint64_t), packed = 1.05;
  const auto points = static_cast<double>(size.points), memory = static_cast<double>(options.memory);
  const double sorting = points * (static_cast<double>(records.bytes()) + key);
  const double sorted = sorting <= .9 * memory / 8 ? 0 : packed * sorting;
  // Until the bounds are known, the records of several pieces wait.
  const double waiting = points * static_cast<double>(records.bytes());
  const bool waits = !size.has_bounds && size.pieces > 1 && waiting > memory / 8;
  return sorted + (waits ? waiting : 0);
}

BuildShape shape_of(const BuildOptions& options, std::size_t attributes, Connectivity connectivity) {
  return {.attributes = attributes,
          .gradients = options.gradients,
          .estimates = connectivity == Connectivity::boxes,
          .index_leaf_points = std::max<std::uint64_t>({options.index_leaf_points, options.leaf_points, 255})};
}

// How many steps of a series are reduced together: as in series_build.cpp.
std::size_t steps_together(const InputSize& size, const BuildOptions& options, std::size_t steps) {
  constexpr std::size_t value_bytes = 256, most = 64;
  const std::uint64_t values = size.points / std::max<std::size_t>(size.pieces, 1) * size.attributes;
  std::size_t together = std::clamp<std::size_t>(options.memory / std::max<std::uint64_t>(values * value_bytes, 1), 1,
                                                 std::min(most, steps));
  const auto least = [&](std::size_t count) {
    return plan_memory(options.memory, shape_of(options, count * size.attributes, Connectivity::mesh)).least;
  };
  while (together > 1 && least(together) > options.memory) --together;
  return together;
}

}  // namespace

Result<InputSize> measure_input(Source& source, bool use_cells, const std::function<void(double)>& progress) {
  InputSize size{.pieces = source.piece_count(),
                 .attributes = source.attributes().size(),
                 .has_planes = use_cells && source.brings_material(),
                 .single_precision = source.single_precision()};
  size.has_material = size.has_planes;
  const std::optional<std::uint64_t> count = source.point_count();
  if (count && (!use_cells || !source.may_have_cells() || source.brings_material())) {
    size.points = *count;
    size.has_bounds = true;  // such inputs find them in a pass over all points, which is not made here
    size.piece_bytes = 2 * bytes_of_piece(std::min<std::uint64_t>(size.points, max_piece_points), 0, size.attributes);
    return size;
  }
  size.was_read = true;
  SPLATVOL_TRY_ASSIGN(bounds, source.bounds());
  size.has_bounds = bounds.has_value();
  source.lend_values();
  std::size_t pieces = 0;
  for (;;) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(piece, source.next());
    if (!piece) break;
    const std::uint64_t tetrahedra = use_cells ? tetrahedra_of(*piece) : 0;
    size.points += piece->points.size();
    size.tetrahedra += tetrahedra;
    size.has_material = size.has_material || tetrahedra > 0 || piece->material.has_value();
    size.piece_bytes = std::max(size.piece_bytes, bytes_of_piece(*piece, size.attributes));
    ++pieces;
    if (progress) progress(static_cast<double>(pieces) / static_cast<double>(std::max(source.piece_count(), pieces)));
  }
  size.pieces = pieces;
  if (size.points == 0) return fail(ErrorCode::invalid_data, "no points");
  return size;
}

BuildEstimate estimate_build(const InputSize& size, const BuildOptions& options, std::size_t steps, unsigned threads) {
  const auto points = static_cast<double>(size.points), tetrahedra = static_cast<double>(size.tetrahedra);
  const auto attributes = static_cast<double>(size.attributes);
  const auto count = static_cast<double>(steps);
  BuildEstimate estimate{.connectivity =
                             size.has_material ? Connectivity::mesh : connectivity_of_points(options, size.points)};

  const FileBytes bytes = file_bytes_of(size, options);
  estimate.file = points * (bytes.geometry + count * attributes * bytes.value) + Range{8 * kibi, 40 * kibi};
  const bool are_joined = estimate.connectivity == Connectivity::delaunay;
  const double cells = !options.keep_cells ? 0 : are_joined ? tetrahedra_of_a_point * points : tetrahedra;  // at most
  estimate.keeps_cells = cells > 0;
  estimate.file = estimate.file + cells * bytes_of_kept_tetrahedron;

  // Steps are reduced together, as many as memory allows: their values are attributes of one source.
  const std::size_t together = steps > 1 ? steps_together(size, options, steps) : 1;
  const std::size_t values = together * size.attributes;
  const PointRecords records = records_of(size, options, values);
  const double temporary = temporary_bytes(size, options, records);
  const bool is_stored =
      estimate.connectivity == Connectivity::none || (are_joined && size.points > options.held_points);  // StoredPoints
  const double stored = is_stored ? points * static_cast<double>(records.bytes()) : 0;
  estimate.disk = {std::max(estimate.file.low, .35 * (temporary + stored)),
                   std::max((steps > 1 ? 2 : 1.4) * estimate.file.high,
                            temporary + stored + cells * spooled_tetrahedron_bytes + estimate.file.high)};

  // Two parts of memory are bounded by what there is to hold.
  const MemoryPlan plan = plan_memory(options.memory, shape_of(options, values, estimate.connectivity));
  const double piece = static_cast<double>(size.piece_bytes) + points / static_cast<double>(size.pieces) *
                                                                   static_cast<double>(values - size.attributes) *
                                                                   sizeof(double);
  estimate.least_memory = std::max(plan.least, static_cast<std::uint64_t>(piece));
  if (are_joined && size.points <= options.held_points)
    estimate.least_memory = std::max(
        estimate.least_memory,
        static_cast<std::uint64_t>(points * static_cast<double>(joined_point_bytes + joined_value_bytes * values)));
  const auto least = static_cast<double>(estimate.least_memory), granted = static_cast<double>(options.memory);
  const double all = points * (2 * static_cast<double>(sorted_bytes(records)) +
                               static_cast<double>(bytes_of_batch_point(values, options.gradients)));
  constexpr Range process{40 * mebi, 130 * mebi};
  const double held = std::min(granted, all);
  estimate.memory = process + Range{std::max(piece / 2, held / 6), std::max(least, piece / 2 + held)};

  const Work work = work_of(size, options, estimate.connectivity);
  const double groups = std::ceil(count / static_cast<double>(together));
  const Range microseconds = points * (groups * work.point + count * attributes * work.value) +
                             count * tetrahedra * work.tetrahedron + cells * microseconds_of_kept_tetrahedron;
  estimate.seconds =
      Range{seconds_of(microseconds.low, threads), seconds_of(microseconds.high, threads)} + Range{.1, .5};
  return estimate;
}

}  // namespace splatvol
