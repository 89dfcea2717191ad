#include "player/streamline_job.h"

#include <utility>

namespace splatvol {

void StreamlineJob::follow(SessionHost& host, const Player& player, const std::vector<SceneStreamlines>& streamlines) {
  constexpr double patience = 0.1;  // seconds
  const StreamlineFile file = player.streamline_file();
  Asked asked;
  if (file.volume && !streamlines.empty())
    asked = {streamlines, file.volume->name(), file.memory, file.volume->step_key()};
  if (!file.volume || asked == asked_) return;
  if (is_begun() && host.now() - begun_ < patience) return;
  end();
  asked_ = std::move(asked);
  begun_ = host.now();
  news_ = std::make_shared<News>();
  std::vector<SceneTubes> before = player.tubes();
  for (SceneTubes& tubes : before) tubes.surface = {}, tubes.room.reset();  // they go once others are shown
  task_ = {host,
           [file, streamlines, before = std::move(before), news = news_] {
             return read_scene_streamlines(streamlines, file, before, [&](std::vector<SceneTubes> tubes) {
               const std::scoped_lock lock(news->mutex);
               news->tubes = std::move(tubes);
             });
           },
           SessionHost::Priority::low};
}

bool StreamlineJob::has_news() const {
  const std::scoped_lock lock(news_->mutex);
  return news_->tubes.has_value() || (is_begun() && task_.wait());
}

std::optional<std::vector<SceneTubes>> StreamlineJob::take(std::optional<Error>& trouble) {
  if (is_begun() && task_.wait()) {
    auto tubes = task_.take();
    news_->tubes.reset();  // some of them, older
    if (tubes) return *std::move(tubes);
    trouble = tubes.error();
    return std::vector<SceneTubes>();
  }
  const std::scoped_lock lock(news_->mutex);
  return std::exchange(news_->tubes, std::nullopt);
}

}  // namespace splatvol
