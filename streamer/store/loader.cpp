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
  threads_.reserve(threads);
  try {
    for (unsigned i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
  } catch (const std::system_error&) {
    // Fewer threads do the same. Without any, `wait_until` reads.
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

namespace {

std::vector<LoadRun> take_all(std::list<LoadRun>& runs) {
  std::vector<LoadRun> taken(std::make_move_iterator(runs.begin()), std::make_move_iterator(runs.end()));
  runs.clear();
  return taken;
}

}  // namespace

void Loader::submit(LoadRun run) {
  {
    const std::scoped_lock lock(mutex_);
    queue_.push_back(std::move(run));
  }
  submitted_.notify_one();
}

std::vector<LoadRun> Loader::withdraw() {
  const std::scoped_lock lock(mutex_);
  return take_all(queue_);
}

std::vector<LoadRun> Loader::extract_done() {
  const std::scoped_lock lock(mutex_);
  return take_all(done_);
}

void Loader::wait_until(std::chrono::steady_clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  const auto is_over = [this] { return !done_.empty() || (queue_.empty() && begun_ == 0); };
  for (auto now = std::chrono::steady_clock::now(); now < deadline && !is_interrupted() && !is_over();
       now = std::chrono::steady_clock::now())
    if (threads_.empty())
      read_next(lock);
    else
      finished_.wait_until(lock, std::min(deadline, now + interruption_delay), is_over);
}

void Loader::read_next(std::unique_lock<std::mutex>& lock) {
  std::list<LoadRun> run;
  run.splice(run.begin(), queue_, queue_.begin());
  ++begun_;
  lock.unlock();
  read_run(volume_, attributes_, run.front());
  for (PartLoad& part : run.front()) part.working = Reservation();
  lock.lock();
  --begun_;
  done_.splice(done_.end(), run);
}

void Loader::work() {
  lower_thread_priority();
  const Interruptible interruptible(stop_.get_token());
  std::unique_lock lock(mutex_);
  for (;;) {
    submitted_.wait_until(lock, no_deadline, [this] { return stop_.stop_requested() || !queue_.empty(); });
    if (stop_.stop_requested()) return;
    read_next(lock);
    finished_.notify_all();
    if (!on_data_) continue;
    lock.unlock();
    on_data_();
    lock.lock();
  }
}

}  // namespace splatvol
