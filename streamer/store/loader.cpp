#include "streamer/store/loader.h"

#include <algorithm>
#include <iterator>
#include <system_error>
#include <utility>

#include "base/clock.h"
#include "base/interruption.h"
#include "base/low_priority.h"

namespace splatvol {

Loader::Loader(const format::Volume& volume, const format::SummaryAttributes& attributes, unsigned threads,
               std::function<void()> on_data)
    : volume_(volume), attributes_(attributes), on_data_(std::move(on_data)) {
  if (!volume.waits()) return;
  threads_.reserve(threads);
  try {
    for (unsigned i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
  } catch (const std::system_error&) {
    // Fewer threads do the same, or none.
  }
}

Loader::~Loader() {
  {
    const std::scoped_lock lock(mutex_);
    stop_.request_stop();
  }
  submitted_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

std::vector<LoadRun> Loader::take_all(std::list<Run>& runs) {
  std::vector<LoadRun> taken;
  for (Run& run : runs) taken.push_back(std::move(run.run));
  runs.clear();
  return taken;
}

void Loader::submit(LoadRun run) {
  if (threads_.empty()) {
    queue_.push_back({std::move(run), std::make_unique<FetchedBytes>()});
    const FetchedBytes::Scope scope(queue_.back().bytes.get());
    prefetch(volume_, queue_.back().run);
    return;
  }
  {
    const std::scoped_lock lock(mutex_);
    queue_.push_back({std::move(run)});
  }
  submitted_.notify_one();
}

std::vector<LoadRun> Loader::withdraw() {
  const std::scoped_lock lock(mutex_);
  return take_all(queue_);
}

std::vector<LoadRun> Loader::extract_done() {
  if (threads_.empty()) decode_what_has_come();
  const std::scoped_lock lock(mutex_);
  return take_all(done_);
}

void Loader::decode_what_has_come() {
  constexpr double patience = 0.008;  // seconds
  const auto start = Clock::now();
  for (auto at = queue_.begin(); at != queue_.end() && seconds_since(start) < patience;) {
    const auto next = std::next(at);
    const FetchedBytes::Scope scope(at->bytes.get());
    if (prefetch(volume_, at->run)) {
      read_run(volume_, attributes_, at->run);
      if (std::ranges::none_of(at->run, [](const PartLoad& part) { return is_pending(part.data); })) {
        for (PartLoad& part : at->run) part.working = Reservation();
        done_.splice(done_.end(), queue_, at);
      }
    }
    at = next;
  }
}

void Loader::wait_until(std::chrono::steady_clock::time_point deadline) {
  if (threads_.empty()) return;
  std::unique_lock lock(mutex_);
  const auto is_over = [this] { return !done_.empty() || (queue_.empty() && begun_ == 0); };
  for (auto now = std::chrono::steady_clock::now(); now < deadline && !is_interrupted() && !is_over();
       now = std::chrono::steady_clock::now())
    finished_.wait_until(lock, std::min(deadline, now + interruption_delay), is_over);
}

void Loader::work() {
  lower_thread_priority();
  const Interruptible interruptible(stop_.get_token());
  std::unique_lock lock(mutex_);
  for (;;) {
    submitted_.wait_until(lock, no_deadline, [this] { return stop_.stop_requested() || !queue_.empty(); });
    if (stop_.stop_requested()) return;
    std::list<Run> run;
    run.splice(run.begin(), queue_, queue_.begin());
    ++begun_;
    lock.unlock();
    read_run(volume_, attributes_, run.front().run);
    for (PartLoad& part : run.front().run) part.working = Reservation();
    lock.lock();
    --begun_;
    done_.splice(done_.end(), run);
    finished_.notify_all();
    if (!on_data_) continue;
    lock.unlock();
    on_data_();
    lock.lock();
  }
}

}  // namespace splatvol
