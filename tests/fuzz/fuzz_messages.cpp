// What splatvol-read sends, to the program that started it: damaged files may have taken it over. The first byte
// chooses the message, the second the number of attributes.
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <numeric>

#include "builder/sources/process/messages.h"
#include "tests/fuzz/fuzz.h"

using namespace splatvol;
using splatvol::fuzz::require;

namespace {

constexpr std::uint64_t most_bytes = 1 << 20;

void read_piece(Channel& channel, std::size_t attributes) {
  Piece piece;
  if (!get(channel, piece, attributes)) return;
  const std::size_t points = piece.points.size();
  for (const auto& tetrahedron : piece.tetrahedra)
    for (const std::uint32_t corner : tetrahedron) require(corner < points, "a corner is a point");
  if (piece.cells) require(piece.cells->points.size() == piece.cells->tetrahedra.size(), "a cell has a point");
  if (!piece.lent) {
    require(piece.values.size() == attributes, "a piece has all attributes");
    return;
  }
  std::vector<std::uint32_t> all(points);
  std::iota(all.begin(), all.end(), 0u);
  std::vector<double> values(points);
  for (std::size_t a = 0; a < attributes; ++a) piece.lent->get(a, all, values);
}

void read_surface(Channel& channel) {
  TriangleMesh mesh;
  if (!get(channel, mesh)) return;
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t corner : triangle) require(corner < mesh.points.size(), "a corner is a point");
}

void read_message(Channel& channel, std::uint8_t kind, std::size_t attributes) {
  if (kind % 6 == 0) {
    SourceState state;
    static_cast<void>(get(channel, state));
  } else if (kind % 6 == 1) {
    Error error;
    static_cast<void>(get(channel, error));
  } else if (kind % 6 == 2) {
    SourceOptions options;
    static_cast<void>(get(channel, options));
  } else if (kind % 6 == 3) {
    read_surface(channel);
  } else if (kind % 6 == 4) {
    std::optional<std::vector<ArrayShape>> arrays;
    static_cast<void>(get(channel, arrays));
  } else {
    read_piece(channel, attributes);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Input input(fuzz::bytes_of(data, size));
  const auto kind = input.take<std::uint8_t>();
  const std::size_t attributes = input.take<std::uint8_t>() % 8;
  std::array<int, 2> ends{};
  require(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) == 0, "there are sockets");
  const auto message = input.rest();
  const ssize_t sent = ::send(ends[0], message.data(), message.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  ::close(ends[0]);
  Channel channel(ends[1], most_bytes);
  if (sent == static_cast<ssize_t>(message.size())) read_message(channel, kind, attributes);
  return 0;
}
