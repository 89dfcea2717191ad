// What an SFTP server sends. The first bytes choose two groups of reads, pieces in which the bytes come, and an answer
// after which the connection is lost or the second group forgotten.
#include <array>
#include <vector>

#include "base/sftp_protocol.h"
#include "tests/fuzz/fuzz.h"

using namespace splatvol;
using splatvol::fuzz::require;

namespace {

constexpr std::size_t most_on_their_way = 32;

class Reader {
 public:
  explicit Reader(fuzz::Input& input)
      : first_(input.take_in(1, 2 * most_sftp_read_bytes)),
        second_(input.take_in(1, 64)),
        event_(input.take<std::uint8_t>()) {
    reads_.add(0, first_, groups_[0]);
    for (std::size_t i = 0; i < second_.size(); ++i) reads_.add(i, std::span(second_).subspan(i, 1), groups_[1]);
    send();
  }

  // Returns false once the server has broken a rule.
  bool take(std::span<const std::byte> bytes) {
    answers_.add(bytes);
    for (;;) {
      const auto answer = answers_.next();
      if (!answer) return false;
      if (!*answer) return true;
      const bool were_awaited = reads_.are_awaited();
      const auto taken = reads_.take(**answer);
      if (!taken) return false;
      require(were_awaited, "an answer is taken for a read only");
      if (++count_ == event_ / 2)
        event_ % 2 ? reads_.lose_answers(Error{ErrorCode::io, "lost"}) : reads_.forget(groups_[1]);
      send();
      for (const SftpReads::Group& group : groups_)
        require(!group.failure || group.left == 0, "a failed group has ended");
    }
  }

 private:
  void send() {
    const std::size_t packet = sftp_read(0, "h", 0, 0).size(), bytes = reads_.take_packets("h").size();
    require(bytes % packet == 0 && bytes / packet <= most_on_their_way, "few reads are on their way");
  }

  std::vector<std::byte> first_, second_;
  std::size_t event_, count_ = 0;
  SftpAnswers answers_;
  std::array<SftpReads::Group, 2> groups_;
  SftpReads reads_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Input input(fuzz::bytes_of(data, size));
  Reader reader(input);
  const std::size_t piece = 1 + input.take<std::uint8_t>() * 16;
  auto rest = input.rest();
  while (!rest.empty() && reader.take(rest.first(std::min(piece, rest.size()))))
    rest = rest.subspan(std::min(piece, rest.size()));
  return 0;
}
