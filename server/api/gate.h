// The gate before the workers: one thread that accepts connections, collects
// requests and sends what workers left unsent, so that workers only ever have
// whole requests to do. Connections that do nothing, dribble or do not read cost
// a descriptor and at most some hundred kilobytes, have deadlines, a least speed
// and limits per peer, and give way to newcomers where there is no room.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <absl/time/time.h>

#include "protocol/base/fd.h"
#include "server/api/connection.h"
#include "server/api/work_queue.h"
#include "server/daemon/server_config.h"

namespace myograde::server {

class Gate {
 public:
  struct Options {
    HttpLimits limits;
    SpoolOptions spool;
    // Who is at the other end of an accepted socket; nullopt: hang up.
    std::function<std::optional<Peer>(int fd)> peer_of;
    std::function<BodyRule(const RequestHead&)> rule_of;
  };
  // `queue` must outlive it.
  Gate(Options options, WorkQueue& queue);
  ~Gate();

  // Accepts from `listener`, which does not block, until Stop. For one thread.
  void Run(int listener);
  // Any thread: a worker is done with a connection that it had of the queue;
  // `next` of it says what to do.
  void Return(Connection* connection);
  // Any thread, and signal handlers too: bodies are refused from now on.
  void Drain();
  // Any thread: Run hangs up on everybody whom no worker has, and returns.
  void Stop();

 private:
  using State = Connection::State;
  using Next = Connection::Next;

  void Accept(int listener);
  // One connection; false: there is none to accept now.
  bool AcceptOne(int listener);
  void RestoreSpare();
  void Admit(Fd socket, const Peer& peer);
  // Makes room for one more of `load`'s; false: nobody can be asked to go.
  bool MakeRoom(const PeerLoad& load);
  Connection* Victim(const std::function<bool(const PeerLoad&)>& among) const;
  void TakeReturned();

  void OnReady(Connection& connection);
  void Do(Connection& connection, Next next);
  void Lend(Connection& connection, WorkKind work);
  // Sends what is left of an answer, then goes on with the next request.
  void Answer(Connection& connection);
  void Refuse(Connection& connection, bool read_on);
  void DrainOne(Connection& connection);
  void Wait(Connection& connection, bool to_send);
  void Enter(Connection& connection, State state);
  // False: its peer has too many, and it was refused.
  bool CountBody(Connection& connection, bool receiving);
  void CountUnsent(Connection& connection);
  void Close(Connection& connection);
  void LookAtClocks();
  bool TooSlow(Connection& connection, absl::Duration now);
  void Wake();

  const Options options_;
  WorkQueue& queue_;
  Fd epoll_;
  Fd wake_;
  std::map<uint64_t, std::unique_ptr<Connection>> connections_;
  std::map<std::string, std::shared_ptr<PeerLoad>> peers_;
  uint64_t next_id_;
  int others_ = 0;                // connections of those who are no organisers
  std::vector<Fd> spare_;         // descriptors to give up when there are no others
  absl::Duration accept_again_;   // not before
  bool accepting_ = true;
  absl::Duration looked_at_;      // the clocks
  std::atomic<bool> draining_ = false;
  std::atomic<bool> stop_ = false;
  std::mutex mutex_;
  std::vector<Connection*> returned_;  // guarded by mutex_
};

}  // namespace myograde::server
