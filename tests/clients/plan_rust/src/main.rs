//! A plan, a fence and a rally point by the crate mavlink. Argument 1 is HOST:PORT of the vehicle.
//!
//! The places are those of plan_places.py.

use mavlink::dialects::common::*;
use mavlink::{MavConnection, MavHeader};
use std::time::{Duration, Instant};

const HOME: (f64, f64) = (47.397742, 8.545594);
const EARTH: f64 = 6_371_000.0;
const JUMP_TO: u16 = 3;
const ACTIVE: MavModeFlag = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;

type Item = (MavCmd, f32, i32, i32, f32); // command, parameter 1, degE7, height

struct Vehicle {
    link: mavlink::Connection<MavMessage>,
    begun: Instant,
    beat: Option<Instant>,
    mode: u32,
    armed: bool,
    current: u16,
    reached: Vec<u16>,
}

fn at(north: f64, east: f64) -> (i32, i32) {
    let lat = HOME.0 + (north / EARTH).to_degrees();
    let lon = HOME.1 + (east / (EARTH * HOME.0.to_radians().cos())).to_degrees();
    ((lat * 1e7).round() as i32, (lon * 1e7).round() as i32)
}

impl Vehicle {
    fn send(&mut self, message: &MavMessage) {
        let header = MavHeader { system_id: 245, component_id: 190, sequence: 0 };
        self.link.send(&header, message).expect("sending");
    }

    /// The next message that matters. Keeps what the vehicle tells of itself, and sends a heartbeat a second.
    fn hear(&mut self) -> MavMessage {
        loop {
            assert!(self.begun.elapsed() < Duration::from_secs(300), "not done within 300 s");
            if self.beat.map_or(true, |t| t.elapsed() > Duration::from_secs(1)) {
                self.beat = Some(Instant::now());
                self.send(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                    mavtype: MavType::MAV_TYPE_GCS,
                    autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                    mavlink_version: 3,
                    ..Default::default()
                }));
            }
            let Ok((_, message)) = self.link.recv() else { continue };
            match &message {
                MavMessage::HEARTBEAT(m) => {
                    self.mode = m.custom_mode;
                    self.armed = m.base_mode.contains(ACTIVE);
                }
                MavMessage::MISSION_CURRENT(m) => self.current = m.seq,
                MavMessage::MISSION_ITEM_REACHED(m) => self.reached.push(m.seq),
                _ => {}
            }
            return message;
        }
    }

    fn wait(&mut self, condition: impl Fn(&Vehicle) -> bool) {
        while !condition(self) {
            self.hear();
        }
    }

    fn upload(&mut self, kind: MavMissionType, items: &[Item]) {
        self.send(&MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: items.len() as u16,
            target_system: 1,
            target_component: 1,
            mission_type: kind,
            ..Default::default()
        }));
        loop {
            let seq = match self.hear() {
                MavMessage::MISSION_REQUEST_INT(m) if m.mission_type == kind => m.seq,
                MavMessage::MISSION_REQUEST(m) if m.mission_type == kind => m.seq,
                MavMessage::MISSION_ACK(m) if m.mission_type == kind => {
                    assert_eq!(m.mavtype, MavMissionResult::MAV_MISSION_ACCEPTED);
                    return;
                }
                _ => continue,
            };
            let (command, param1, x, y, z) = items[seq as usize];
            self.send(&MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                param1, x, y, z, seq, command,
                target_system: 1,
                target_component: 1,
                frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
                current: (seq == 0) as u8,
                autocontinue: 1,
                mission_type: kind,
                ..Default::default()
            }));
        }
    }

    fn download(&mut self, kind: MavMissionType) -> Vec<MISSION_ITEM_INT_DATA> {
        self.send(&MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
            target_system: 1,
            target_component: 1,
            mission_type: kind,
        }));
        let count = loop {
            if let MavMessage::MISSION_COUNT(m) = self.hear() {
                break m.count;
            }
        };
        let mut items = Vec::new();
        for seq in 0..count {
            self.send(&MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
                seq,
                target_system: 1,
                target_component: 1,
                mission_type: kind,
            }));
            items.push(loop {
                if let MavMessage::MISSION_ITEM_INT(m) = self.hear() {
                    break m;
                }
            });
        }
        items
    }

    fn command(&mut self, command: MavCmd, param1: f32, param2: f32, param3: f32) {
        self.send(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command, param1, param2, param3,
            target_system: 1,
            target_component: 1,
            ..Default::default()
        }));
    }
}

fn main() {
    let address = std::env::args().nth(1).expect("HOST:PORT of the vehicle");
    let link = mavlink::connect::<MavMessage>(&format!("udpout:{address}")).expect("connecting");
    let mut v = Vehicle {
        link, begun: Instant::now(), beat: None, mode: 0, armed: false, current: 0, reached: vec![],
    };
    // by UDP the vehicle answers whoever has sent it a heartbeat
    v.send(&MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype: MavType::MAV_TYPE_GCS, ..Default::default() }));
    v.wait(|v| v.mode != 0);
    let place = |command, (x, y): (i32, i32), z| (command, 0.0f32, x, y, z);
    let go = MavCmd::MAV_CMD_NAV_WAYPOINT;
    let plan = [
        place(MavCmd::MAV_CMD_NAV_TAKEOFF, at(0.0, 0.0), 6.0),
        place(go, at(40.0, 0.0), 8.0),
        place(go, at(40.0, -40.0), 8.0),
        place(go, at(40.0, 20.0), 8.0),
        place(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, (0, 0), 0.0),
    ];
    let mission = MavMissionType::MAV_MISSION_TYPE_MISSION;
    v.upload(mission, &plan);
    println!("upload");
    let given: Vec<Item> =
        v.download(mission).iter().map(|m| (m.command, m.param1, m.x, m.y, m.z)).collect();
    assert_eq!(given, plan);
    println!("download");
    let corners = [at(-40.0, -60.0), at(-40.0, 60.0), at(70.0, 60.0), at(70.0, -60.0)]
        .map(|(x, y)| (MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, 4.0, x, y, 0.0));
    v.upload(MavMissionType::MAV_MISSION_TYPE_FENCE, &corners);
    println!("fence");
    let rally = [place(MavCmd::MAV_CMD_NAV_RALLY_POINT, at(32.0, 20.0), 0.0)];
    v.upload(MavMissionType::MAV_MISSION_TYPE_RALLY, &rally);
    println!("rally");

    let auto = |sub: u32| 4 << 16 | sub << 24;
    v.command(MavCmd::MAV_CMD_MISSION_START, 0.0, 0.0, 0.0);
    v.wait(|v| v.reached.contains(&0));
    println!("fly");
    v.command(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0, 0.0, 0.0);
    v.wait(|v| v.mode == auto(3));
    println!("pause");
    v.command(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0, 0.0, 0.0);
    v.wait(|v| v.mode == auto(4));
    println!("resume");
    v.send(&MavMessage::MISSION_SET_CURRENT(MISSION_SET_CURRENT_DATA {
        seq: JUMP_TO,
        target_system: 1,
        target_component: 1,
    }));
    v.wait(|v| v.current == JUMP_TO);
    println!("jump");
    v.wait(|v| v.reached.contains(&JUMP_TO) && !v.armed);
    v.send(&MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: mission,
    }));
    while !matches!(v.hear(), MavMessage::MISSION_ACK(_)) {}
    assert!(v.download(mission).is_empty());
    println!("clear");
}
