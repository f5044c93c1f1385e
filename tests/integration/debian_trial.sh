# What an operator does with the packages in a bare Debian 12, in order. Runs as root in the machine of
# debian_test.py. /root has packages/, server.pem and server.key. Each
# step says how it ended, and the first that fails is the last.
step() {
  local ended=$?
  echo "step $1: $ended"
  [ "$ended" = 0 ] || { journalctl -u myograded --no-pager -o cat | tail -n 60; exit 1; }
}
installed() { apt-get install -y -q --no-install-recommends "$@" >/root/apt.log 2>&1 || { tail -n 20 /root/apt.log; false; }; }
value() { systemctl show -p "$1" --value "${2:-myograded.service}"; }
# The daemon is asked for a minute before it counts as gone.
answers() { timeout 60 sh -c 'until myograde status >/dev/null 2>&1; do sleep 1; done'; }
log_of_this_start() { journalctl "_SYSTEMD_INVOCATION_ID=$(value InvocationID)" --no-pager -o cat; }
status_of() { sed -n "s/^$1:[[:space:]]*//p" "/proc/$(value MainPID)/status"; }
# A track that an emulated processor plays within a minute.
short_track() {
  echo '{"form": 2, "extends": "elbow", "seeds": {"first": 0, "count": 4}, "episodes_per_lease": 2}' \
    >/etc/myograde/tracks/short.json
}
board() { myograde leaderboard --track short --json; }
# For half a minute submit waits itself for the reference episodes, which an emulated processor plays longer.
submit() {
  local tries
  for tries in 1 2 3 4 5 6; do
    timeout 600 myograde submit /usr/lib/myograde/policies/scripted-elbow --track short --team "$1" --wait >submit.log 2>&1
    local ended=$?
    cat submit.log
    grep -q "reference episodes" submit.log || return $ended
  done
  return 1
}
grade() { submit "$1" | tr '\r' '\n' | tail -n 40; [ "${PIPESTATUS[0]}" = 0 ]; }
cd /root || exit
data=/var/lib/myograde
unit=/etc/systemd/system/myograded.service.d
echo "kernel $(uname -r), $(stat -f -c %T /sys/fs/cgroup)"

# Installed.
installed ./packages/*.deb; step install
systemd-analyze verify --man=no myograded.service myograded.socket myograded-https.socket; step verify
myograde-setup >setup.log 2>&1 || { tail -n 60 setup.log; false; }; step setup
grep cgroup_ setup.log; grep -q "cgroup_memory.*version 2" setup.log; step groups_for_sandboxes
short_track
systemctl enable --now myograded.socket myograded.service 2>&1; step start
answers; step answers
[ "$(stat -c '%U %a' $data)" = "myograde 700" ] && [ "$(stat -c %U $data/store.db)" = myograde ]; step data_is_the_users

# Hardened, and grading.
[ "$(ps -o user= -p "$(value MainPID)")" = myograde ]; step own_user
[ "$(status_of CapBnd)" = 0000000000000000 ] && [ "$(status_of CapEff)" = 0000000000000000 ]; step no_capabilities
systemd-analyze security --no-pager --threshold=29 myograded.service | tail -n 1; [ "${PIPESTATUS[0]}" = 0 ]; step exposure
grep -q '/myograded.service/daemon$' "/proc/$(value MainPID)/cgroup"; step leaf_group
grade First; step grade
board >board.json; step board
myograde show 1 >/dev/null; step show
adduser --quiet --disabled-password --gecos "" ada && adduser --quiet ada myograde; step user
su - ada -c 'timeout 600 myograde submit /usr/lib/myograde/policies/scripted-elbow --track short --team Ada --wait >submit.log 2>&1' || { tail -n 3 ~ada/submit.log; false; }; step member_submits
su nobody -s /bin/sh -c 'myograde status' 2>stranger.log; [ $? = 3 ]; step stranger_is_kept_out
cat stranger.log; grep -q "adduser nobody myograde" stranger.log; step stranger_is_told
adduser --quiet --disabled-password --gecos "" eve; step other_user
# Whoever belongs to nothing plays and draws for herself.
su - eve -c 'timeout 900 myograde local /usr/lib/myograde/policies/scripted-elbow --track short --episodes 1 --logs logs && timeout 600 myograde episode replay logs/* && { timeout 600 myograde episode render logs/* -o end.png 2>render.log || grep libosmesa6 render.log; }' >eve.log 2>&1 || { tail -n 5 eve.log; false; }; step ordinary_user_plays_and_looks

# Watched: a daemon that hangs is killed and started again.
mkdir -p $unit && printf '[Service]\nWatchdogSec=15\n' >$unit/watchdog.conf && systemctl daemon-reload && systemctl restart myograded.service; step watchdog_set
before=$(value MainPID)
kill -STOP "$before"
timeout 150 sh -c "while [ \"\$(systemctl show -p MainPID --value myograded.service)\" = $before ]; do sleep 1; done"; step hung_daemon_is_killed
answers; step started_again
[ "$(value NRestarts)" = 1 ]; step restarted_once
rm $unit/watchdog.conf && systemctl daemon-reload && systemctl restart myograded.service && answers; step watchdog_reset

# A port of the network, from systemd.
install -o myograde -m 0400 server.pem server.key /etc/myograde
python3 - <<'CONFIG'
import json
path = "/etc/myograde/server.json"
config = json.load(open(path))
config["http"]["listen"] = {"address": "0.0.0.0", "port": 9443, "certificate": "/etc/myograde/server.pem",
                            "key": "/etc/myograde/server.key"}
json.dump(config, open(path, "w"), indent=2)
CONFIG
step configure_port
# A network whose packets go nowhere.
ip link add dummy0 type dummy && ip address add 192.0.2.10/24 dev dummy0 && ip link set dummy0 up; step network
systemctl restart myograded.service && answers; step port_without_systemd
journalctl -u myograded --no-pager | grep "can't reach other hosts"; step filter_is_told
install -D -m 0644 -t $unit /usr/share/myograde/systemd/network.conf && systemctl daemon-reload; step network_conf
systemctl restart myograded.service && answers && ! log_of_this_start | grep "can't reach other hosts"; step filter_is_lifted
rm $unit/network.conf && systemctl daemon-reload
# Without user namespaces the log says what to do.
namespaces=$(sysctl -n user.max_user_namespaces)
sysctl -q user.max_user_namespaces=0 && systemctl restart myograded.service && answers; step no_namespaces
log_of_this_start | grep "create user namespaces on this host, so nothing can be graded"; step lack_is_told
sysctl -q "user.max_user_namespaces=$namespaces"; step namespaces
systemctl stop myograded.service && systemctl enable --now myograded-https.socket && systemctl start myograded.service; step port
answers && python3 -c '
import ssl, urllib.request
context = ssl.create_default_context(cafile="/root/server.pem")
assert urllib.request.urlopen("https://127.0.0.1:8443/v1/live", context=context, timeout=60).status == 200'; step port_answers
[ "$(cat $data/listen)" = "https://[::]:8443" ] || { cat $data/listen; false; }; step port_is_told

# The same package again, over a running daemon.
before=$(value MainPID)
board >board.json
cp setup.log before-upgrade.log
apt-get install -y -q --no-install-recommends --reinstall ./packages/myograde-client_*.deb ./packages/myograde-server_*.deb >apt.log 2>&1; step upgrade
[ "$before" != "$(value MainPID)" ]; step upgrade_restarts
answers && board | cmp - board.json; step same_board
systemctl stop myograded.service && myograde status >/dev/null; step activated

# Removed and purged.
apt-get remove -y -q myograde-server >apt.log 2>&1; step remove
[ -e $data/store.db ] && [ -e /etc/myograde/server.json ]; step kept
rm /etc/myograde/tracks/short.json
mkdir -p /etc/systemd/system/myograded-https.socket.d && printf '[Socket]\nBacklog=512\n' >/etc/systemd/system/myograded-https.socket.d/own.conf
apt-get purge -y -q 'myograde-*' libmyograde-policy-dev python3-myograde >apt.log 2>&1; step purge
left() { ! find / -xdev -name '*myograde*' -not -path '/root/*' -not -path '/var/log/*' -not -path '/proc/*' \
  -not -path '/var/cache/apt/*' -not -path '/var/lib/systemd/coredump/*' | grep .; }
left; step clean
! getent passwd myograde && ! getent group myograde; step no_user
journalctl -u myograded --no-pager -o cat | tail -n 80
