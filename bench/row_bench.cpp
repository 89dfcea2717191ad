// From a warm file to drawing records: row_bench [--kernel octant] FILE.svol...
// Reads and decodes all rows of the finest resolution, on one thread and on two. Prints, for each file, the medians of
// several repeats: millions of records a second, and nanoseconds a record of each part of the work, summed over
// threads.
#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <string_view>
#include <thread>
#include <vector>

#include "base/file.h"
#include "format/volume.h"
#include "streamer/store/decode.h"

namespace splatvol {
namespace {

constexpr int repeats = 9;

// Seconds: of the clock; and of processors, for each part.
struct Times {
  double all = 0, read = 0, shapes = 0, values = 0;
};

// Processor time of this thread, in seconds.
double processor_seconds() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

struct Row {
  std::uint32_t points;
  format::ChunkLocation positions, shapes, values;
};

// The columns of positions, shapes and values of the first attribute.
Result<std::array<int, 3>> columns_of(const format::Volume& volume, KernelKind kernel) {
  using format::ColumnKind;
  const format::VolumeInfo& info = volume.info();
  const bool octant = kernel == KernelKind::octant;
  const std::array columns{info.find_column(octant ? ColumnKind::position : ColumnKind::centroid),
                           info.find_column(octant ? ColumnKind::octant : ColumnKind::moments),
                           info.find_column(octant ? ColumnKind::value : ColumnKind::value_moments, 0)};
  if (std::ranges::min(columns) < 0)
    return fail(ErrorCode::invalid_argument, "{}: no attribute, or not the columns of this kernel", volume.name());
  return columns;
}

Result<std::vector<Row>> finest_rows(const format::Volume& volume, KernelKind kernel) {
  SPLATVOL_TRY_ASSIGN(columns, columns_of(volume, kernel));
  const std::size_t finest = volume.info().resolutions() - 1;
  std::vector<Row> rows;
  for (std::uint64_t number = 0; number < volume.rows().group_count(); ++number) {
    const format::Group group = volume.rows().group(number);
    Row row{group.count, {}, {}, {}};
    const std::array locations{&row.positions, &row.shapes, &row.values};
    for (std::size_t k = 0; k < 3; ++k) {
      const bool once =
          volume.info().columns[static_cast<std::size_t>(columns[k])].scope == format::ColumnScope::segment;
      const std::uint64_t row_number = volume.rows().row(once ? group.segment : finest, number);
      SPLATVOL_TRY_ASSIGN(page, volume.read_directory_page(volume.directory_page_of_row(row_number, columns[k])));
      *locations[k] = volume.find_chunk(page, row_number, columns[k]);
    }
    rows.push_back(row);
  }
  return rows;
}

// Decodes a row, and adds up the times of its parts.
Result<RecordRow> decode(const format::Volume& volume, KernelKind kernel, const Row& row, Times& times) {
  const double start = processor_seconds();
  SPLATVOL_TRY_ASSIGN(positions, volume.read_bytes(row.positions.offset, row.positions.entry.packed_bytes));
  SPLATVOL_TRY_ASSIGN(shapes, volume.read_bytes(row.shapes.offset, row.shapes.entry.packed_bytes));
  SPLATVOL_TRY_ASSIGN(values, volume.read_bytes(row.values.offset, row.values.entry.packed_bytes));
  const double read = processor_seconds();
  SPLATVOL_TRY_ASSIGN(shape_row, decode_shapes(kernel, {row.positions.entry, positions}, {row.shapes.entry, shapes},
                                               row.points, volume.info().cube, volume.name()));
  const double shaped = processor_seconds();
  SPLATVOL_TRY_ASSIGN(value_row, decode_values(kernel, {{row.values.entry, values}}, row.points, volume.name()));
  times.read += read - start;
  times.shapes += shaped - read;
  times.values += processor_seconds() - shaped;
  return RecordRow{std::make_shared<ShapeRow>(std::move(shape_row)), std::make_shared<ValueRow>(std::move(value_row))};
}

// Decodes all rows, and keeps them until the end.
Result<Times> decode_all(const format::Volume& volume, KernelKind kernel, std::span<const Row> rows, int threads) {
  std::vector<RecordRow> records(rows.size());
  std::vector<Times> parts(static_cast<std::size_t>(threads));
  std::vector<Status> states(static_cast<std::size_t>(threads));
  std::atomic<std::size_t> next = 0;
  const auto work = [&](std::size_t thread) {
    for (std::size_t i = next++; i < rows.size(); i = next++) {
      auto row = decode(volume, kernel, rows[i], parts[thread]);
      if (!row)
        states[thread] = tl::unexpected(row.error());
      else
        records[i] = std::move(*row);
    }
  };
  const auto start = std::chrono::steady_clock::now();
  std::vector<std::thread> others;
  for (std::size_t thread = 1; thread < parts.size(); ++thread) others.emplace_back(work, thread);
  work(0);
  for (std::thread& other : others) other.join();
  Times sum{.all = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count()};
  for (const Status& state : states) SPLATVOL_TRY(state);
  for (const Times& part : parts) {
    sum.read += part.read;
    sum.shapes += part.shapes;
    sum.values += part.values;
  }
  return sum;
}

double median(std::vector<Times> times, double Times::*of) {
  std::ranges::sort(times, {}, of);
  return times[times.size() / 2].*of;
}

Status measure(const std::string& path, KernelKind kernel) {
  SPLATVOL_TRY_ASSIGN(source, open_file(path));
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(source)));
  SPLATVOL_TRY_ASSIGN(rows, finest_rows(*volume, kernel));
  double records = 0, packed = 0;
  for (const Row& row : rows) {
    records += row.points;
    packed += row.positions.entry.packed_bytes + row.shapes.entry.packed_bytes + row.values.entry.packed_bytes;
  }
  for (const int threads : {1, 2}) {
    std::vector<Times> times;
    for (int i = 0; i < repeats; ++i) {
      SPLATVOL_TRY_ASSIGN(time, decode_all(*volume, kernel, rows, threads));
      times.push_back(time);
    }
    const auto each = [&](double Times::*of) { return 1e9 * median(times, of) / records; };
    fmt::print("| {} | {:.0f} | {:.1f} | {} | {:.1f} | {:.0f} | {:.0f} | {:.0f} |\n", path, records, packed / records,
               threads, 1e-6 * records / median(times, &Times::all), each(&Times::read), each(&Times::shapes),
               each(&Times::values));
  }
  return {};
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using splatvol::KernelKind;
  KernelKind kernel = KernelKind::moments;
  fmt::print("| file | records | packed bytes each | threads | M records/s | ns: read | shapes | values |\n");
  fmt::print("|---|---|---|---|---|---|---|---|\n");
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument = argv[i];
    if (argument == "--kernel" && i + 1 < argc) {
      kernel = std::string_view(argv[++i]) == "octant" ? KernelKind::octant : KernelKind::moments;
      continue;
    }
    const auto status = splatvol::measure(argv[i], kernel);
    if (status) continue;
    fmt::print(stderr, "row_bench: {}\n", status.error().message);
    return 1;
  }
}
