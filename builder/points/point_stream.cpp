#include "builder/points/point_stream.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include "base/temp_file.h"
#include "builder/mesh/boundary.h"
#include "builder/sorting/record_spool.h"
#include "format/codec.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr std::size_t points_at_once = 1 << 14;  // that a task makes records of

// More points of one key than this are not compared with each other at a time. No vertex belongs to more pieces.
constexpr std::size_t longest_run(bool of_vertices) { return of_vertices ? std::size_t{1} << 16 : 4096; }

bool is_finite(const dvec3& p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); }

// What single precision cannot hold is taken for the fill value of a program, that is for missing.
double present_or_nan(double value) {
  return std::abs(value) <= std::numeric_limits<float>::max() ? value : std::numeric_limits<double>::quiet_NaN();
}

// Single precision loses the detail of a narrow range far from zero (pressures round 101325 Pa); an offset keeps it.
double choose_offset(double low, double high) {
  const double largest = std::max(std::abs(low), std::abs(high));
  const bool fine = largest * std::exp2(-24) <= (high - low) * std::exp2(-16);
  return largest == 0 || fine ? 0.0 : low + (high - low) / 2;
}

format::Attribute describe_attribute(const std::string& name, double low, double high) {
  format::Attribute attribute;
  attribute.name = name;
  if (!(low <= high)) return attribute;
  attribute.offset = choose_offset(low, high);
  // Of the values as they are stored, so that bins and ranges agree with them to the last bit.
  attribute.min = attribute.offset + static_cast<float>(low - attribute.offset);
  attribute.max = attribute.offset + static_cast<float>(high - attribute.offset);
  return attribute;
}

// The smallest cube round the points; of edge 1 where they all coincide, as a size must come from somewhere.
Result<Cube> bounding_cube(const Box& box) {
  const dvec3 extent = box.high - box.low;
  const double edge = std::max({extent.x, extent.y, extent.z});
  if (!std::isfinite(edge)) return fail(ErrorCode::invalid_data, "the points lie too far apart for double precision");
  return Cube{box.low, edge > std::numeric_limits<double>::min() ? edge : 1.0};
}

// A vertex as all pieces know it.
struct Corner {
  dvec3 position;
  std::uint64_t sample;  // hash of its values
};
bool operator==(const Corner& a, const Corner& b) { return a.position == b.position && a.sample == b.sample; }
bool operator<(const Corner& a, const Corner& b) {
  return std::tie(a.position.x, a.position.y, a.position.z, a.sample) <
         std::tie(b.position.x, b.position.y, b.position.z, b.sample);
}

// An outer face of a piece.
struct Face {
  std::array<Corner, 3> corners;  // ascending
  dvec3 area;                     // vector, outwards; 0 where it does not count
};

// A third of an outer face of the whole mesh.
struct CornerArea {
  Corner corner;
  dvec3 area;
};

template <class T>
T record_at(std::span<const std::byte> records, std::size_t i) {
  T record;
  std::memcpy(&record, records.data() + i * sizeof(T), sizeof(T));
  return record;
}

template <class Record, class Key>
KeyFunction key_function(Key key) {
  return [key](std::span<const std::byte> records, std::span<MortonKey> keys) {
    for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = key(record_at<Record>(records, i));
  };
}

// Equal faces get equal keys; what else does only costs a comparison.
MortonKey face_key(const Face& face) {
  const std::uint64_t hash = format::hash_bytes(std::as_bytes(std::span(face.corners)));
  return {hash >> 1, 0};
}

std::uint64_t hash_values(const PointRecords& layout, const std::byte* record) {
  return format::hash_bytes(layout.sample(record).subspan(layout.position_bytes()));
}

// Where points lie, and between which numbers their values.
struct Ranges {
  Box box;
  std::vector<double> low, high;  // [attribute]

  explicit Ranges(std::size_t attributes) : low(attributes, infinity), high(attributes, -infinity) {}

  void include(const Ranges& other) {
    box.include(other.box);
    for (std::size_t a = 0; a < low.size(); ++a) {
      low[a] = std::min(low[a], other.low[a]);
      high[a] = std::max(high[a], other.high[a]);
    }
  }
};

// Reads an input's pieces into records.
class PieceReader {
 public:
  PieceReader(Source& source, const PointRecords& layout, std::size_t memory, const std::string& folder)
      : source_(source), layout_(layout), memory_(memory), folder_(folder), ranges_(source.attributes().size()) {}

  // Calls take(records) for each piece.
  template <class Take>
  Status run(const std::function<void(double)>& progress, const Take& take) {
    for (std::size_t pieces = 0;; ++pieces) {
      progress(static_cast<double>(pieces) / static_cast<double>(std::max(source_.piece_count(), pieces + 1)));
      SPLATVOL_TRY_ASSIGN(piece, source_.next());
      if (!piece) break;
      SPLATVOL_TRY(read(*piece));
      SPLATVOL_TRY(take(std::span<const std::byte>(records_)));
    }
    if (!(box().low.x <= box().high.x)) return fail(ErrorCode::invalid_data, "no point with finite coordinates");
    return {};
  }

  const Box& box() const { return ranges_.box; }
  std::optional<ExternalSorter>& faces() { return faces_; }

  InputSummary summary() const {
    InputSummary summary;
    for (std::size_t a = 0; a < layout_.attributes(); ++a)
      summary.attributes.push_back(describe_attribute(source_.attributes()[a], ranges_.low[a], ranges_.high[a]));
    summary.cells = cells_;
    summary.census = census_;
    summary.has_material = has_material_;
    if (cells_.tetrahedra == 0) summary.census.in_no_cell = 0;
    return summary;
  }

 private:
  Status read(const Piece& piece) {
    if (piece.tetrahedra.size() > std::numeric_limits<std::uint32_t>::max())
      return fail(ErrorCode::unsupported, "a piece has {} tetrahedra, which is too many: split it",
                  piece.tetrahedra.size());
    std::vector<std::size_t> kept(piece.points.size());
    std::size_t count = 0;
    for (std::size_t i = 0; i < piece.points.size(); ++i) {
      kept[count] = i;
      count += is_finite(piece.points[i]) ? 1 : 0;
    }
    kept.resize(count);
    census_.read += piece.points.size();
    census_.not_finite += piece.points.size() - count;
    cells_ += piece.census;

    records_.resize(count * layout_.bytes());
    std::vector<Ranges> ranges((count + points_at_once - 1) / points_at_once, Ranges(layout_.attributes()));
    tbb::parallel_for(std::size_t{0}, ranges.size(), [&](std::size_t r) {
      const std::size_t first = r * points_at_once;
      const auto part = std::span(kept).subspan(first, std::min(points_at_once, count - first));
      make_records(piece, part, records_.data() + first * layout_.bytes());
      find_ranges(piece, part, ranges[r]);
    });
    for (const Ranges& range : ranges) ranges_.include(range);  // in order, as 0 and -0 are equal
    if (layout_.has_material() && piece.material) {
      add_material(*piece.material, kept);
      return {};
    }
    if (layout_.has_material() && !piece.tetrahedra.empty()) return add_material(piece, kept);
    census_.in_no_cell += kept.size();
    return {};
  }

  // Of these points, without material.
  void make_records(const Piece& piece, std::span<const std::size_t> points, std::byte* record) const {
    if (layout_.has_material()) std::memset(record, 0, points.size() * layout_.bytes());
    for (const std::size_t i : points) {
      layout_.set_position(record, piece.points[i]);
      for (std::size_t a = 0; a < layout_.attributes(); ++a)
        layout_.set_value(record, a, present_or_nan(piece.values[a][i]));
      record += layout_.bytes();
    }
  }

  void find_ranges(const Piece& piece, std::span<const std::size_t> points, Ranges& ranges) const {
    for (const std::size_t i : points) ranges.box.include({piece.points[i], piece.points[i]});
    for (std::size_t a = 0; a < layout_.attributes(); ++a) {
      double low = infinity, high = -infinity;
      for (const std::size_t i : points) {
        const double value = present_or_nan(piece.values[a][i]);
        low = value < low ? value : low;
        high = value > high ? value : high;
      }
      ranges.low[a] = low;
      ranges.high[a] = high;
    }
  }

  void add_material(const PointMaterial& material, const std::vector<std::size_t>& kept) {
    has_material_ = true;
    tbb::parallel_for(std::size_t{0}, kept.size(), [&](std::size_t k) {
      std::byte* record = records_.data() + k * layout_.bytes();
      layout_.set_vertex(record, {1.0, material.moments[kept[k]]});
      for (std::size_t a = 0; a < layout_.attributes(); ++a)
        layout_.set_value_part(record, a, {material.value_moments[a][kept[k]], material.gradients[a][kept[k]]});
      if (!material.planes.empty()) layout_.set_plane(record, material.planes[kept[k]]);
    });
  }

  Status add_material(const Piece& piece, const std::vector<std::size_t>& kept) {
    has_material_ = true;
    std::vector<bool> used(piece.points.size());
    for (const auto& corners : piece.tetrahedra)
      for (const std::uint32_t corner : corners) used[corner] = true;
    for (const std::size_t i : kept) census_.in_no_cell += used[i] ? 0 : 1;

    std::vector<std::vector<double>> values = piece.values;
    for (std::vector<double>& of_attribute : values)
      std::ranges::transform(of_attribute, of_attribute.begin(), present_or_nan);
    const VertexMaterial mesh(piece.points, piece.tetrahedra);
    tbb::parallel_for(std::size_t{0}, kept.size(), [&](std::size_t k) {
      std::byte* record = records_.data() + k * layout_.bytes();
      layout_.set_vertex(record, {used[kept[k]] ? 1.0 : 0.0, mesh.moments(kept[k])});
      for (std::size_t a = 0; a < layout_.attributes(); ++a)
        layout_.set_value_part(record, a, {mesh.value_moments(kept[k], values[a]), mesh.gradient(kept[k], values[a])});
    });
    return add_faces(piece, kept);
  }

  Status add_faces(const Piece& piece, const std::vector<std::size_t>& kept) {
    if (!faces_) {
      SPLATVOL_TRY_ASSIGN(
          faces, ExternalSorter::create({sizeof(Face), key_function<Face>(face_key), memory_, memory_, folder_}));
      faces_.emplace(std::move(faces));
    }
    std::vector<std::size_t> places(piece.points.size());
    for (std::size_t k = 0; k < kept.size(); ++k) places[kept[k]] = k;
    std::vector<Face> faces;
    for (const OuterFace& outer : find_outer_faces(piece.points, piece.tetrahedra)) {
      Face face{};
      const auto at = [&](std::size_t c) { return piece.points[outer.corners[c]] + 0.0; };  // not -0
      if (outer.has_side) face.area = glm::cross(at(1) - at(0), at(2) - at(0)) / 2.0;
      const double square = glm::dot(face.area, face.area);
      if (!(square > 0) || !std::isfinite(square)) face.area = dvec3(0);
      for (std::size_t c = 0; c < 3; ++c)
        face.corners[c] = {at(c), hash_values(layout_, records_.data() + places[outer.corners[c]] * layout_.bytes())};
      std::ranges::sort(face.corners, std::less<>());
      faces.push_back(face);
    }
    return faces_->add(std::as_bytes(std::span(faces)));
  }

  Source& source_;
  const PointRecords& layout_;
  std::size_t memory_;
  std::string folder_;
  std::vector<std::byte> records_;
  Ranges ranges_;
  CellCensus cells_;
  PointCensus census_;
  bool has_material_ = false;
  std::optional<ExternalSorter> faces_;
};

// The faces of one piece only, a third of each at each of its corners, by Morton order. Faces between pieces come
// twice.
Result<ExternalSorter> sort_corners(ExternalSorter faces, const Cube& cube, std::size_t memory,
                                    const std::string& folder) {
  const auto key = [cube](const CornerArea& corner) { return morton_key(corner.corner.position, cube); };
  SPLATVOL_TRY_ASSIGN(
      corners, ExternalSorter::create({sizeof(CornerArea), key_function<CornerArea>(key), memory, memory, folder}));
  SPLATVOL_TRY(faces.finish());
  std::vector<Face> run;  // of one key
  MortonKey run_key;
  const auto flush = [&]() -> Status {
    for (std::size_t i = 0; i < run.size(); ++i) {
      const auto same = std::ranges::count_if(run, [&](const Face& face) { return face.corners == run[i].corners; });
      const auto& [a, b, c] = run[i].corners;
      if (same > 1 || a == b || b == c || run[i].area == dvec3(0)) continue;
      std::array<CornerArea, 3> thirds;
      for (std::size_t k = 0; k < 3; ++k) thirds[k] = {run[i].corners[k], run[i].area / 3.0};
      SPLATVOL_TRY(corners.add(std::as_bytes(std::span(thirds))));
    }
    run.clear();
    return {};
  };
  for (;;) {
    SPLATVOL_TRY_ASSIGN(block, faces.next());
    if (block.keys.empty()) break;
    for (std::size_t i = 0; i < block.keys.size(); ++i) {
      if (!run.empty() && block.keys[i] != run_key) SPLATVOL_TRY(flush());
      run_key = block.keys[i];
      run.push_back(record_at<Face>(block.records, i));
    }
  }
  SPLATVOL_TRY(flush());
  SPLATVOL_TRY(corners.finish());
  return corners;
}

// Of the finished file, a point, at least; it takes shape while the sorted points are still there.
constexpr std::uint64_t least_file_bytes = 20;

// Better before the work than in the middle of it.
Status check_room(const std::string& folder, std::uint64_t points, std::uint64_t sort_bytes) {
  SPLATVOL_TRY_ASSIGN(room, free_disk_bytes(folder));
  const std::uint64_t needed = sort_bytes + points * least_file_bytes;
  if (needed > room)
    return fail(ErrorCode::io, "{}: {} points need at least {} bytes there, and {} are free", folder, points, needed,
                room);
  return {};
}

}  // namespace

PointStream::PointStream(PointRecords layout, InputSummary summary, ExternalSorter points,
                         std::optional<ExternalSorter> corners)
    : layout_(layout), summary_(std::move(summary)), points_(std::move(points)), corners_(std::move(corners)) {}

Result<PointStream> PointStream::create(Source& source, bool use_cells, std::size_t memory, const std::string& folder,
                                        const std::function<void(double)>& progress) {
  const PointRecords layout(source.attributes().size(), source.single_precision(), use_cells && source.may_have_cells(),
                            use_cells && source.brings_material());
  const std::size_t face_memory = std::max(memory / 8, ExternalSorter::least_memory(sizeof(Face)));
  PieceReader reader(source, layout, face_memory, folder);

  std::optional<ExternalSorter> points;
  const auto start_sort = [&](const Cube& cube, std::size_t bytes) -> Status {
    const auto key = [layout, cube](std::span<const std::byte> records, std::span<MortonKey> keys) {
      for (std::size_t i = 0; i < keys.size(); ++i)
        keys[i] = morton_key(layout.position(records.data() + i * layout.bytes()), cube);
    };
    const std::size_t least = ExternalSorter::least_memory(layout.bytes());
    SPLATVOL_TRY_ASSIGN(sorter, ExternalSorter::create({layout.bytes(), key, std::max(bytes, least),
                                                        std::max(memory / 4, least), folder}));
    points.emplace(std::move(sorter));
    const std::uint64_t count = source.point_count().value_or(0);
    return check_room(folder, count, points->temp_bytes(count));
  };

  Cube cube;
  SPLATVOL_TRY_ASSIGN(bounds, source.bounds());
  if (bounds) {
    SPLATVOL_TRY_ASSIGN(bounding, bounding_cube(*bounds));
    cube = bounding;
    SPLATVOL_TRY(start_sort(cube, memory));
    SPLATVOL_TRY(reader.run(progress, [&](std::span<const std::byte> records) { return points->add(records); }));
  } else {
    // Keys need the bounds of all points: they wait until these are known.
    RecordSpool spool(layout.bytes(), memory / 4, folder);
    SPLATVOL_TRY(reader.run(progress, [&](std::span<const std::byte> records) { return spool.append(records); }));
    SPLATVOL_TRY_ASSIGN(bounding, bounding_cube(reader.box()));
    cube = bounding;
    SPLATVOL_TRY(start_sort(cube, memory / 2));
    for (;;) {
      SPLATVOL_TRY_ASSIGN(records, spool.next());
      if (records.empty()) break;
      SPLATVOL_TRY(points->add(records));
    }
  }
  SPLATVOL_TRY(points->finish());

  std::optional<ExternalSorter> corners;
  if (reader.faces()) {
    SPLATVOL_TRY_ASSIGN(sorted, sort_corners(std::move(*reader.faces()), cube, face_memory, folder));
    corners.emplace(std::move(sorted));
  }
  InputSummary summary = reader.summary();
  summary.box = reader.box();
  summary.cube = cube;
  return PointStream(layout, std::move(summary), std::move(*points), std::move(corners));
}

Result<bool> PointStream::next(PointBatch& batch) {
  const std::size_t longest = longest_run(layout_.has_material());
  // Until at least one run is whole.
  std::size_t whole = 0;
  while (whole == 0 && !ended_) {
    SPLATVOL_TRY_ASSIGN(block, points_.next());
    ended_ = block.keys.empty();
    raw_.insert(raw_.end(), block.records.begin(), block.records.end());
    keys_.insert(keys_.end(), block.keys.begin(), block.keys.end());
    whole = keys_.size();
    if (ended_) break;
    while (whole > 0 && keys_[whole - 1] == keys_.back()) --whole;
    // Parts of a longer run begin at the same points wherever blocks end.
    whole += (keys_.size() - whole) / longest * longest;
  }
  if (whole == 0 && ended_) return false;

  const std::size_t first = batch.positions.size();
  for (std::size_t begin = 0; begin < whole;) {
    std::size_t end = begin + 1;
    while (end < whole && end - begin < longest && keys_[end] == keys_[begin]) ++end;
    SPLATVOL_TRY(take_run(begin, end, batch));
    begin = end;
  }
  raw_.erase(raw_.begin(), raw_.begin() + static_cast<std::ptrdiff_t>(whole * layout_.bytes()));
  keys_.erase(keys_.begin(), keys_.begin() + static_cast<std::ptrdiff_t>(whole));
  if (corners_) SPLATVOL_TRY(append_planes(batch, first));
  return true;
}

// Neighbouring pieces of a mesh repeat their common vertices. Of points with one key, keeps the first of equal samples
// that belong to cells; points of no cell are samples of their own, however often they come.
Status PointStream::take_run(std::size_t begin, std::size_t end, PointBatch& batch) {
  const auto count_if_repeated = [&](std::size_t first, std::size_t last) {
    const dvec3 place = layout_.position(record(first));
    if (last_key_ == keys_[begin] && last_position_ == place) ++summary_.census.coincident;
    last_key_ = keys_[begin];
    last_position_ = layout_.position(record(last));
  };
  if (end - begin == 1) {
    count_if_repeated(begin, begin);
    append(begin, batch);
    return {};
  }
  // Equal samples side by side, the first in the input in front.
  std::vector<std::size_t> order(end - begin);
  std::iota(order.begin(), order.end(), begin);
  const auto position = [&](std::size_t i) {
    const dvec3 p = layout_.position(record(i));
    return std::tuple(p.x, p.y, p.z);
  };
  const auto values = [&](std::size_t i) { return layout_.sample(record(i)).subspan(layout_.position_bytes()); };
  std::ranges::stable_sort(order, [&](std::size_t i, std::size_t j) {
    if (position(i) != position(j)) return position(i) < position(j);
    return std::ranges::lexicographical_compare(values(i), values(j));
  });
  const auto in_cell = [&](std::size_t i) { return layout_.has_material() && layout_.vertex(record(i)).in_cell != 0; };
  std::vector<std::size_t> into(end - begin);  // [point]: that of the same sample which is kept
  count_if_repeated(order.front(), order.back());
  std::size_t kept = order[0];
  into[kept - begin] = kept;
  for (std::size_t k = 1; k < order.size(); ++k) {
    const std::size_t next = order[k];
    const bool coincident = position(next) == position(order[k - 1]);
    if (coincident && in_cell(kept) && in_cell(next) && position(next) == position(kept) &&
        std::ranges::equal(values(kept), values(next))) {
      into[next - begin] = kept;
      ++summary_.census.merged;
      continue;
    }
    if (coincident) ++summary_.census.coincident;
    into[next - begin] = kept = next;
  }

  std::vector<std::size_t> places(end - begin);
  for (std::size_t i = begin; i < end; ++i) {
    if (into[i - begin] == i) {
      places[i - begin] = batch.positions.size();
      append(i, batch);
    } else {
      merge_into(batch, places[into[i - begin] - begin], i);
    }
  }
  return {};
}

void PointStream::append(std::size_t i, PointBatch& batch) const {
  const std::byte* at = record(i);
  batch.keys.push_back(keys_[i]);
  batch.positions.push_back(layout_.position(at));
  for (std::size_t a = 0; a < layout_.attributes(); ++a) batch.values[a].push_back(layout_.value(at, a));
  if (!summary_.has_material) return;
  batch.moments.push_back(layout_.vertex(at).moments);
  for (std::size_t a = 0; a < layout_.attributes(); ++a) {
    const PointRecords::ValuePart part = layout_.value_part(at, a);
    batch.value_moments[a].push_back(part.moments);
    batch.gradients[a].push_back(part.gradient);
  }
  if (layout_.has_planes()) batch.planes.push_back(layout_.plane(at));
}

// Two copies of a vertex own what each piece gives them.
void PointStream::merge_into(PointBatch& batch, std::size_t place, std::size_t i) const {
  const std::byte* at = record(i);
  merge(batch.moments[place], layout_.vertex(at).moments, dvec3(0));
  for (std::size_t a = 0; a < layout_.attributes(); ++a) {
    const PointRecords::ValuePart part = layout_.value_part(at, a);
    merge(batch.value_moments[a][place], part.moments, dvec3(0));
    batch.gradients[a][place] += part.gradient;
  }
}

Result<bool> PointStream::peek_corner() {
  if (next_corner_ == corner_block_.keys.size()) {
    SPLATVOL_TRY_ASSIGN(block, corners_->next());
    corner_block_ = block;
    next_corner_ = 0;
  }
  return !corner_block_.keys.empty();
}

// Each point's faces come with the same key.
Status PointStream::append_planes(PointBatch& batch, std::size_t begin) {
  batch.planes.resize(batch.positions.size());
  std::vector<CornerArea> here;
  for (std::size_t first = begin, end = begin; first < batch.positions.size(); first = end) {
    while (end < batch.positions.size() && batch.keys[end] == batch.keys[first]) ++end;
    here.clear();
    for (;;) {
      SPLATVOL_TRY_ASSIGN(any, peek_corner());
      if (!any || corner_block_.keys[next_corner_] > batch.keys[first]) break;
      if (corner_block_.keys[next_corner_] == batch.keys[first])
        here.push_back(record_at<CornerArea>(corner_block_.records, next_corner_));
      ++next_corner_;
    }
    if (here.empty()) continue;
    std::vector<std::byte> sample(layout_.bytes());
    for (std::size_t i = first; i < end; ++i) {
      layout_.set_position(sample.data(), batch.positions[i]);
      for (std::size_t a = 0; a < layout_.attributes(); ++a) layout_.set_value(sample.data(), a, batch.values[a][i]);
      const Corner corner{batch.positions[i], hash_values(layout_, sample.data())};
      std::vector<BoundaryPlane> incident;
      for (const CornerArea& third : here)
        if (third.corner == corner) incident.push_back({third.area, 0});
      batch.planes[i] = merge_planes(incident, std::vector<dvec3>(incident.size(), dvec3(0)));
    }
  }
  return {};
}

}  // namespace splatvol
