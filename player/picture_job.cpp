#include "player/picture_job.h"

#include <utility>

namespace splatvol {
namespace {

// Lists of splats are large, and hold rows.
FrameSplats without_list(const FrameSplats& frame) {
  return {{},
          {},
          frame.serial,
          frame.nodes,
          frame.splats,
          frame.nodes_by_resolution,
          frame.splats_by_resolution,
          frame.detail,
          frame.expected_error,
          frame.goal_error,
          frame.finest,
          frame.progress};
}

}  // namespace

LastPicture::LastPicture(Player& player)
    : exact(player.exact()),
      nodes(player.streamer().drawn_nodes()),
      statistics(player.streamer().statistics()),
      is_reading_ahead(player.is_reading_ahead()),
      left_out(player.left_out()),
      cells(player.cells_for_picks()),
      surfaces(player.surfaces()) {
  if (const FrameSplats* last = player.frame()) frame = without_list(*last);
}

void PictureJob::begin(SessionHost& host, Work work, Player& player, std::function<Status()> draw) {
  last_ = LastPicture(player);
  work_ = work;
  const auto priority = work == Work::moving ? SessionHost::Priority::usual : SessionHost::Priority::low;
  drawing_ = {host,
              [this, &host, draw = std::move(draw), start = host.now()] {
                Status drawn = draw();
                seconds_ = host.now() - start;
                return drawn;
              },
              priority};
}

double PictureJob::take_seconds() { return std::exchange(seconds_, 0); }

}  // namespace splatvol
