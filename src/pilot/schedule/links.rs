//! Links come and go.

use haltere_core::time::HostTime;

use super::act::Act;
use crate::input::LinkId;
use crate::out::voice::Severity;
use crate::view::view;

impl Act<'_> {
    pub(crate) fn link_up(&mut self, at: HostTime, link: LinkId) {
        match link {
            LinkId::Tag => {
                self.navigation.tag_up(&view!(self, at), self.out);
            }
            LinkId::Board => {
                // The rest of a frame that was cut off will not come.
                self.board.splitter.flush();
                self.board_frames(at);
                self.board.link.restart(at);
                if self.board.link.system_id().is_none() {
                    self.board.peers.forget();
                }
            }
            LinkId::Ground(n) => {
                let n = usize::from(n);
                if n < self.stations.grounds.len() {
                    self.stations.grounds[n].splitter.flush();
                    self.ground_frames(at, n);
                    self.stations.grounds[n].begin_anew(at);
                    self.out.opens(link, self.stations.grounds[n].wants_events());
                    self.greet(at, link);
                }
            }
        }
    }

    pub(crate) fn link_down(&mut self, at: HostTime, link: LinkId) {
        match link {
            LinkId::Tag => {
                self.navigation.tag_down(&view!(self, at), self.out);
            }
            LinkId::Board => self.out.say(at, Severity::Error, "board disconnected".to_owned()),
            LinkId::Ground(n) => {
                self.stations.services_forget(link);
                self.stations.station_left(at, n, self.out);
            }
        }
    }
}
