#include "builder/sources/hdf5/netcdf_checks.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "base/file.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::uint64_t largest_header = 64 << 20;

tl::unexpected<Error> fail_cut(const std::string& path, std::uint64_t stated, std::uint64_t there) {
  return fail(ErrorCode::invalid_data, "{}: the file is cut off: its header states {} bytes, and there are {}", path,
              stated, there);
}

tl::unexpected<Error> fail_header(const std::string& path) {
  return fail(ErrorCode::invalid_data, "{}: the file is cut off within its header, or damaged", path);
}

/// Reads the header of a file in NetCDF's own format. Numbers are big-endian; a count has 4 bytes, or 8 in version 5.
class NetcdfHeader {
 public:
  explicit NetcdfHeader(std::string_view bytes) : bytes_(bytes), version_(static_cast<unsigned char>(bytes[3])) {}

  /// Returns whether the header is whole. Call it first.
  bool read() {
    at_ = 4;
    records_ = count();
    read_dimensions();
    skip_attributes();
    read_variables();
    return !damaged_;
  }

  /// The smallest size of the file that holds all variables.
  [[nodiscard]] std::uint64_t stated_bytes() const {
    std::uint64_t end = at_;
    for (const Variable& variable : variables_) {
      if (variable.record && (records_ == 0 || is_open())) continue;
      const std::uint64_t before = variable.record ? multiply(records_ - 1, record_bytes()) : 0;
      end = std::max(end, add(add(variable.begin, before), variable.bytes));
    }
    return end;
  }

  /// Whether the header leaves the number of records open: whoever wrote it did not know how many would follow.
  [[nodiscard]] bool is_open() const { return records_ == (version_ == 5 ? ~std::uint64_t{0} : 0xffffffff); }

  /// The number of whole records in a file of this size.
  [[nodiscard]] std::uint64_t records_in(std::uint64_t file_bytes) const {
    std::uint64_t first_end = 0;
    for (const Variable& variable : variables_)
      if (variable.record) first_end = std::max(first_end, add(variable.begin, variable.bytes));
    if (record_bytes() == 0 || file_bytes < first_end) return 0;
    return 1 + (file_bytes - first_end) / record_bytes();
  }

 private:
  struct Variable {
    std::uint64_t begin = 0;
    std::uint64_t bytes = 0;  // of a record, or of all values
    bool record = false;
  };

  /// From one record to the next. The records of a single variable have no padding between them.
  [[nodiscard]] std::uint64_t record_bytes() const {
    std::uint64_t padded = 0, bare = 0;
    std::size_t variables = 0;
    for (const Variable& variable : variables_) {
      if (!variable.record) continue;
      ++variables;
      bare = variable.bytes;
      padded = add(padded, add(variable.bytes, 3) / 4 * 4);
    }
    return variables == 1 ? bare : padded;
  }

  // Sums and products that overflow become the largest number.
  static std::uint64_t add(std::uint64_t a, std::uint64_t b) { return a + b < a ? ~std::uint64_t{0} : a + b; }
  static std::uint64_t multiply(std::uint64_t a, std::uint64_t b) {
    return b != 0 && a > ~std::uint64_t{0} / b ? ~std::uint64_t{0} : a * b;
  }

  std::uint64_t number(std::size_t bytes) {
    damaged_ = damaged_ || bytes > bytes_.size() - at_;
    if (damaged_) return 0;
    at_ += bytes;
    return number_in(bytes_.substr(at_ - bytes, bytes), true);
  }
  std::uint64_t count() { return number(version_ == 5 ? 8 : 4); }

  /// Skips bytes and their padding to a multiple of four.
  void skip(std::uint64_t bytes) {
    if (bytes > bytes_.size() - at_ || (bytes + 3) / 4 * 4 > bytes_.size() - at_) damaged_ = true;
    if (!damaged_) at_ += static_cast<std::size_t>((bytes + 3) / 4 * 4);
  }

  /// Reads the tag and the length of a list.
  std::uint64_t list() {
    number(4);
    return count();
  }

  void read_dimensions() {
    for (std::uint64_t left = list(); left > 0 && !damaged_; --left) {
      skip(count());
      dimensions_.push_back(count());
    }
  }

  std::uint64_t value_bytes() {
    constexpr std::array<std::uint64_t, 12> sizes = {0, 1, 1, 2, 4, 4, 8, 1, 2, 4, 8, 8};
    const std::uint64_t type = number(4);
    damaged_ = damaged_ || type == 0 || type >= sizes.size();
    return damaged_ ? 0 : sizes[type];
  }

  void skip_attributes() {
    for (std::uint64_t left = list(); left > 0 && !damaged_; --left) {
      skip(count());
      const std::uint64_t bytes = value_bytes();
      skip(multiply(count(), bytes));
    }
  }

  void read_variables() {
    for (std::uint64_t left = list(); left > 0 && !damaged_; --left) {
      skip(count());
      Variable variable;
      variable.bytes = 1;
      const std::uint64_t rank = count();
      for (std::uint64_t d = 0; d < rank && !damaged_; ++d) {
        const std::uint64_t dimension = count();
        damaged_ = damaged_ || dimension >= dimensions_.size();
        if (damaged_) return;
        variable.record = variable.record || (d == 0 && dimensions_[dimension] == 0);
        if (d > 0 || !variable.record) variable.bytes = multiply(variable.bytes, dimensions_[dimension]);
      }
      skip_attributes();
      variable.bytes = multiply(variable.bytes, value_bytes());
      count();  // the size, which is wrong for large variables
      variable.begin = number(version_ == 1 ? 4 : 8);
      variables_.push_back(variable);
    }
  }

  std::string_view bytes_;
  unsigned version_;
  std::size_t at_ = 0;
  bool damaged_ = false;
  std::uint64_t records_ = 0;
  std::vector<std::uint64_t> dimensions_;  // 0: of records
  std::vector<Variable> variables_;
};

Status check_netcdf(ByteSource& file, const std::string& path) {
  SPLATVOL_TRY_ASSIGN(bytes, read_text(file, 0, largest_header));
  NetcdfHeader header(bytes);
  const bool whole = header.read();
  if (!whole && file.size() > largest_header) return {};  // the library tells
  if (!whole) return fail_header(path);
  return header.stated_bytes() <= file.size() ? Status{} : fail_cut(path, header.stated_bytes(), file.size());
}

/// The end that the superblock of an HDF5 file states.
Status check_hdf5(ByteSource& file, const std::string& path, std::string_view start) {
  const unsigned version = start.size() > 8 ? static_cast<unsigned char>(start[8]) : 99;
  const std::size_t size_at = version < 2 ? 13 : 9, end_at = version == 0 ? 40 : version == 1 ? 44 : 28;
  if (version > 3 || start.size() < end_at + 8) return fail_header(path);
  if (start[size_at] != 8) return {};
  const std::uint64_t stated = number_in(start.substr(end_at, 8), false);
  return stated <= file.size() ? Status{} : fail_cut(path, stated, file.size());
}

bool is_adf(std::string_view start) { return start.size() > 4 && start.substr(4).starts_with("ADF Database Version"); }

/// Reads an integer of an ADF header: hexadecimal digits, or bytes in an order ('L' little-endian, 'B' big-endian).
std::optional<std::uint64_t> adf_number(std::string_view bytes, bool is_text, char order) {
  if (!is_text) return number_in(bytes, order == 'B');
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(bytes.data(), bytes.data() + bytes.size(), value, 16);
  return error == std::errc() && end == bytes.data() + bytes.size() ? std::optional(value) : std::nullopt;
}

/// The header of ADF, the older format of CGNS, states the last byte that is used: a block of 4096 bytes, and an offset
/// in it. Before version B, numbers are texts.
Status check_adf(ByteSource& file, const std::string& path, std::string_view start) {
  constexpr std::size_t version_at = 25, order_at = 100, block_at = 146, offset_at = 154, header_bytes = 186;
  constexpr std::uint64_t block_bytes = 4096, most_blocks = std::uint64_t{1} << 48;
  if (start.size() < header_bytes) return fail_header(path);
  const bool is_text = start[version_at] == 'A';
  const char order = start[order_at];
  if (!is_text && order != 'L' && order != 'B')
    return fail(ErrorCode::unsupported, "{}: its numbers are not those of IEEE 754: convert it (cgnsconvert)", path);
  const auto block = adf_number(start.substr(block_at, 8), is_text, order);
  const auto offset = adf_number(start.substr(offset_at, 4), is_text, order);
  if (!block || !offset || *block > most_blocks || *offset > block_bytes) return fail_header(path);
  const std::uint64_t stated = *block * block_bytes + *offset + 1;
  return stated <= file.size() ? Status{} : fail_cut(path, stated, file.size());
}

}  // namespace

Result<std::optional<std::uint64_t>> count_open_records(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  SPLATVOL_TRY_ASSIGN(bytes, read_text(*file, 0, largest_header));
  if (!is_netcdf(bytes)) return std::optional<std::uint64_t>();
  NetcdfHeader header(bytes);
  if (!header.read() || !header.is_open()) return std::optional<std::uint64_t>();
  return std::optional(header.records_in(file->size()));
}

Status check_file_end(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  SPLATVOL_TRY_ASSIGN(start, read_text(*file, 0, 256));
  if (is_hdf5(start)) return check_hdf5(*file, path, start);
  if (is_adf(start)) return check_adf(*file, path, start);
  return is_netcdf(start) ? check_netcdf(*file, path) : Status{};
}

}  // namespace splatvol
